from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import pandas as pd
import pytest
from typer.testing import Result

from torch_activegp.errors import ConfigurationError, DataError

Run = Callable[..., Result]
Slide = Callable[..., str]
Record = Callable[[str, int, int], pd.DataFrame]

RESULTS = {"settings.json", "diagnosis.json", "report.html"}


@dataclasses.dataclass
class Found:
    """A diagnosis of the plainest kind; its verdict may be one that no report can show."""

    verdict: str
    sentence: str
    evidence: Any = dataclasses.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        return {"schema_version": 1, "verdict": self.verdict, "sentence": self.sentence, "effects": [], "fit": {}}

    def save(self, folder: Path) -> None:
        (folder / "diagnosis.json").write_text(json.dumps(self.to_dict()))


@dataclasses.dataclass
class Fake:
    """Stands in for the diagnosis: keeps what it was called with, and fails where it was told to, by folder."""

    calls: list[dict[str, Any]] = dataclasses.field(default_factory=list)
    errors: dict[str, BaseException] = dataclasses.field(default_factory=dict)
    verdict: str = "none"

    def __call__(self, model: Path, fit: Any, test: Any, *, seed: int, nthread: int, tell: Any) -> Found:
        tell("naming", 0.5)
        name = model.parent.name
        runs = [run.name for run in fit], [run.name for run in test]
        self.calls.append({"name": name, "runs": runs, "seed": seed, "nthread": nthread})
        if name in self.errors:
            raise self.errors[name]
        return Found(self.verdict, f"What {name} [bold]lacks[/].")

    @property
    def names(self) -> list[str]:
        return [call["name"] for call in self.calls]


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Fake:
    made = Fake()
    monkeypatch.setattr("torch_activegp.diagnosis.diagnose", made)
    return made


@pytest.fixture(autouse=True)
def files(folder: Path, slide: Slide, record_slide: Record) -> None:
    """Two slides; what both models lack is friction on the first, and nothing on the second."""
    for name, loss in (("one", "damping='1' frictionloss='0.5'"), ("two", "")):
        (folder / "machines" / name).mkdir(parents=True)
        (folder / "machines" / name / "slide.xml").write_text(slide(loss=""))
        for seed, run in enumerate(("run1", "test")):
            table = record_slide(slide(loss=loss), seed, 300)
            table.to_csv(folder / "machines" / name / f"{run}.csv", index=False)


ALL = ("diagnose-all", "machines/one", "machines/two", "--out", "out", "--jobs", "1")


def contents(folder: Path) -> dict[str, set[str]]:
    return {path.name: {file.name for file in path.iterdir()} for path in folder.iterdir()}


def flat(text: str) -> str:
    return " ".join(text.split())


def test_each_machine_has_its_folder_and_the_table_names_all(run: Run, folder: Path, fake: Fake) -> None:
    result = run(*ALL, "--seed", "3")
    assert result.exit_code == 0
    assert contents(folder / "out") == {"one": RESULTS, "two": RESULTS}
    for words in (
        "│ one │ none │ What one [bold]lacks[/].",
        "│ two │ none │ What two [bold]lacks[/].",
        "2 machines diagnosed, 0 skipped, 0 failed. See out.",
    ):
        assert words in flat(result.stdout)
    assert [call["runs"] for call in fake.calls] == [(["run1.csv"], ["test.csv"])] * 2
    assert [(call["seed"], call["nthread"]) for call in fake.calls] == [(3, 1)] * 2
    assert json.loads((folder / "out" / "two" / "settings.json").read_text()) == {
        "command": "diagnose",
        "model": "machines/two/slide.xml",
        "recordings": ["machines/two/run1.csv"],
        "holdout": ["machines/two/test.csv"],
        "columns": None,
        "seed": 3,
    }


def test_what_is_there_is_skipped_and_shown(run: Run, folder: Path, fake: Fake) -> None:
    assert run(*ALL).exit_code == 0
    before = (folder / "out" / "one" / "diagnosis.json").stat().st_mtime_ns
    (folder / "out" / "two" / "diagnosis.json").unlink()
    for path in (folder / "out" / "two").iterdir():
        path.unlink()
    result = run(*ALL)
    assert result.exit_code == 0
    assert fake.names == ["one", "two", "two"]
    assert (folder / "out" / "one" / "diagnosis.json").stat().st_mtime_ns == before
    assert result.stderr == "Skipped, because out holds them: 1 of 2 machines.\n"
    assert "What one" in result.stdout
    assert "1 machine diagnosed, 1 skipped, 0 failed" in flat(result.stdout)


def test_a_result_of_something_else_is_skipped_and_said(run: Run, folder: Path, fake: Fake) -> None:
    assert run(*ALL).exit_code == 0
    (folder / "machines" / "one" / "run2.csv").write_bytes((folder / "machines" / "one" / "run1.csv").read_bytes())
    (folder / "out" / "two" / "settings.json").unlink()
    result = run(*ALL, "--seed", "1")
    assert (result.exit_code, fake.names) == (0, ["one", "two"])
    said = "one: skipped, though its results are of another recordings, another seed. Remove out/one to diagnose it"
    assert said in result.stderr
    assert "two:" not in result.stderr


def test_a_machine_with_bad_data_stops_no_other_and_is_tried_again(run: Run, folder: Path, fake: Fake) -> None:
    fake.errors["one"] = DataError("run1.csv: no excitation.")
    (folder / "machines" / "empty").mkdir()
    result = run(*ALL, "machines/empty")
    assert result.exit_code == 1
    assert contents(folder / "out") == {"two": RESULTS}
    assert "one: run1.csv: no excitation.\n" in result.stderr
    assert "empty: machines/empty: one MJCF file *.xml wanted, found none" in result.stderr
    assert "│ one │ failed │ run1.csv: no excitation." in flat(result.stdout)
    assert "│ two │ none │" in flat(result.stdout)
    assert "1 machine diagnosed, 0 skipped, 2 failed" in flat(result.stdout)
    fake.errors.clear()
    assert run(*ALL).exit_code == 0
    assert contents(folder / "out") == {"one": RESULTS, "two": RESULTS}
    assert fake.names == ["one", "two", "one"]


def test_files_of_a_machine_are_whole_or_absent(run: Run, folder: Path, fake: Fake) -> None:
    (folder / "out" / ".one.part").mkdir(parents=True)  # of a run that was killed
    (folder / "out" / ".one.part" / "old").touch()
    (folder / "out" / "one").mkdir()
    fake.verdict = "perhaps"
    result = run(*ALL)
    assert result.exit_code == 1
    assert "perhaps" in result.stderr
    assert contents(folder / "out") == {"one": set()}
    fake.verdict = "none"
    assert run(*ALL).exit_code == 0
    assert contents(folder / "out") == {"one": RESULTS, "two": RESULTS}


def test_ctrl_c_keeps_what_was_done_and_the_same_command_goes_on(run: Run, folder: Path, fake: Fake) -> None:
    fake.errors["two"] = KeyboardInterrupt()
    result = run(*ALL)
    assert result.exit_code == 130
    assert "Interrupted. out keeps every machine that was done: the same command goes on with the" in result.stderr
    assert contents(folder / "out") == {"one": RESULTS}
    fake.errors.clear()
    assert run(*ALL).exit_code == 0
    assert fake.names == ["one", "two", "two"]


def test_a_disk_that_cannot_be_written_ends_all(
    run: Run, folder: Path, fake: Fake, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: Any) -> None:
        raise ConfigurationError("Cannot write: No space left on device.")

    monkeypatch.setattr("torch_activegp.cli.diagnose_all.write_json", full)
    result = run(*ALL)
    assert (result.exit_code, fake.names) == (2, ["one"])
    assert "No space left on device" in result.stderr
    assert contents(folder / "out") == {}


def test_the_output_folder_among_the_machines_is_none(run: Run, folder: Path, fake: Fake) -> None:
    words = ("diagnose-all", "machines/one", "machines/out", "--out", "machines/out", "--jobs", "1")
    (folder / "machines" / "out").mkdir()
    assert run(*words).exit_code == 0
    assert contents(folder / "machines" / "out") == {"one": RESULTS}


def test_a_column_map(run: Run, folder: Path, fake: Fake) -> None:
    for path in (folder / "machines" / "one").glob("*.csv"):
        pd.read_csv(path).set_axis(["t", "x", "u"], axis=1).to_csv(path, index=False)
    (folder / "map.toml").write_text('time = "t"\nqpos.slide = { column = "x", unit = "mm" }\nctrl.push = "u"\n')
    words = ("diagnose-all", "machines/one", "--out", "out", "--jobs", "1", "--columns", "map.toml")
    assert run(*words).exit_code == 0
    assert json.loads((folder / "out" / "one" / "settings.json").read_text())["columns"] == "map.toml"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere"], "nowhere: a folder with one machine wanted; there is none."),
        (["rod.xml"], "rod.xml: a folder with one machine wanted; there is none."),
        (["machines/one", "other/one"], "machines/one and other/one are both named one"),
        (["out"], "No machine: out is the output folder."),
        (["machines/one", "--columns", "nowhere.toml"], "nowhere.toml: no such file"),
        (["machines/one", "--out", "rod.xml"], "rod.xml"),
        (["machines/taken"], "out/taken is there and holds no diagnosis.json. Move it, or choose another --out."),
        (["machines/damaged"], "diagnosis.json is damaged"),
        (["machines/one", "--backend", "dask"], "--backend"),
        (["machines/one", "--jobs", "-1"], "--jobs"),
    ],
)
def test_bad_words_get_one_message_and_exit_code_2(
    run: Run, folder: Path, fake: Fake, words: list[str], message: str
) -> None:
    for name in ("machines/taken", "machines/damaged", "other/one", "out/taken", "out/damaged"):
        (folder / name).mkdir(parents=True)
    (folder / "out" / "taken" / "notes.txt").touch()
    (folder / "out" / "damaged" / "diagnosis.json").write_text("{")
    result = run("diagnose-all", "--out", "out", *words)
    assert result.exit_code == 2
    assert message in flat(result.stderr)
    assert fake.calls == []


def test_ray_that_is_not_installed(run: Run, folder: Path, fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    result = run(*ALL, "--backend", "ray")
    assert result.exit_code == 2
    assert "pip install 'torch-activegp[ray]'" in result.stderr
    assert not (folder / "out").exists()


def test_help_teaches(run: Run) -> None:
    output = flat(run("diagnose-all", "--help").output)
    for words in ("torch-activegp diagnose-all machines/* --out results", "--backend", "loky|ray", "*.xml", "holdout"):
        assert words in output


def test_two_machines_are_diagnosed(run: Run, folder: Path) -> None:
    result = run(*ALL)
    assert result.exit_code == 0
    found = {name: json.loads((folder / "out" / name / "diagnosis.json").read_text()) for name in ("one", "two")}
    assert {effect["name"] for effect in found["one"]["effects"]} == {"coulomb_friction", "viscous_friction"}
    assert found["two"]["verdict"] == "none"
    corrected = mujoco.MjModel.from_xml_path(str(folder / "out" / "one" / "corrected.xml"))
    assert corrected.dof_frictionloss[0] == pytest.approx(0.5, rel=0.1)
    assert RESULTS <= contents(folder / "out")["one"]
