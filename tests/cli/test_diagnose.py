from __future__ import annotations

import dataclasses
import json
import logging
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
from typer.testing import Result

from torch_activegp.data import Recording
from torch_activegp.diagnosis import Checkpoint
from torch_activegp.errors import DataError
from torch_activegp.report.numbers import MISSING
from torch_activegp.simulators import Simulator

Run = Callable[..., Result]
Slide = Callable[..., str]
Record = Callable[[str, int, int], pd.DataFrame]

RESULTS = {"settings.json", "diagnosis.json", "report.html", "corrected.xml"}


def named() -> dict[str, Any]:
    return {
        "schema_version": 1,
        "verdict": "named",
        "sentence": "Coulomb friction at joint slide explains 91 % of the mismatch.",
        "mismatch": {"detected": True, "p_value": 1e-9, "chi2_per_dof": 8.1, "noise": {"qpos.slide": 3e-4}},
        "location": [],
        "effects": [
            {
                "name": "coulomb_friction",
                "target": "joint:slide",
                "share": 0.91,
                "probability": 0.98,
                "parameters": {"level": {"value": 0.312, "unit": "N", "ci95": [0.293, 0.331]}},
                "ties": [],
            },
            {
                "name": "actuator_gain",
                "target": "actuator:push",
                "share": 0.07,
                "probability": 0.52,
                "parameters": {
                    "gain": {"value": 0.83, "unit": "", "ci95": None},
                    "periods": {"value": 7.0, "unit": "1/turn", "ci95": [6.9, 7.1]},
                },
                "ties": [{"name": "payload_mass", "target": "body:cart"}],
            },
        ],
        "unexplained": {"share": 0.02, "white": True},
        "fit": {
            "holdout": {
                "one_step": {"before": 0.2, "after": 0.02, "noise": 0.019},
                "free_run": {"before": 2.4, "after": None, "noise": 0.002},
            }
        },
        "next_experiment": {"separates": [], "why": "a heavier load moves both apart", "controls": "next.csv"},
        "notes": ["a.csv: [bold]Columns[/] left out: x."],
        "retuned": [{"name": "armature_error", "target": "joint:slide", "parameters": {}}],
        "stability": {"effects": [], "sound": True, "sentence": "Each recording left out in turn: 2 of 2."},
    }


def plain(verdict: str) -> dict[str, Any]:
    return {"schema_version": 1, "verdict": verdict, "sentence": f"This is {verdict}.", "effects": [], "fit": {}}


@dataclasses.dataclass
class Fake:
    """Stands in for the diagnosis: keeps what it was called with, and gives what it was told to."""

    found: dict[str, Any]
    error: BaseException | None = None
    keeps: bool = False
    key: str = "k"
    saved: BaseException | None = None
    early: tuple[str, ...] = ()
    calls: list[dict[str, Any]] = dataclasses.field(default_factory=list)

    def __call__(
        self,
        model: Path | Simulator,
        recordings: Sequence[Recording],
        holdout: Sequence[Recording] = (),
        *,
        seed: int = 0,
        nthread: int = 0,
        tell: Callable[[str, float | None], None] | None = None,
        checkpoint: Checkpoint | None = None,
    ) -> Fake:
        assert tell is not None
        assert checkpoint is not None
        checkpoint.open(self.key)
        checkpoint.once("naming", lambda: 1) if self.keeps else None
        for note in self.early:
            logging.getLogger("torch_activegp.diagnosis.diagnose").warning(note)
        tell("noise floor", None)
        tell("naming", 0.5)
        self.calls.append({"model": model, "fit": recordings, "test": holdout, "seed": seed, "nthread": nthread})
        if self.error is not None:
            raise self.error
        return self

    @property
    def sentence(self) -> str:
        return self.found["sentence"]

    evidence: Any = dataclasses.field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        return self.found

    def save(self, folder: Path) -> None:
        (folder / "diagnosis.json").write_text(json.dumps(self.found))
        if self.saved is not None:
            raise self.saved
        (folder / "corrected.xml").write_text("<mujoco/>")


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Fake:
    made = Fake(named())
    monkeypatch.setattr("torch_activegp.diagnosis.diagnose", made, raising=False)
    return made


@pytest.fixture(autouse=True)
def files(folder: Path, slide: Slide, record_slide: Record) -> None:
    """A slide without losses, and recordings of a real one: positions alone, with noise."""
    (folder / "slide.xml").write_text(slide(loss=""))
    (folder / "broken.xml").write_text("<mujoco><worldbody>")
    (folder / "text.xml").write_text("time,qpos.slide\n")
    real = slide(loss="damping='1' frictionloss='0.5'")
    for seed, name in enumerate(("a", "b", "c")):
        record_slide(real, seed, 600).to_csv(folder / f"{name}.csv", index=False)


def change(folder: Path, edit: Callable[[pd.DataFrame], pd.DataFrame], name: str = "bad.csv") -> None:
    edit(pd.read_csv(folder / "a.csv")).to_csv(folder / name, index=False)


def listing(folder: Path) -> dict[str, bytes]:
    return {
        str(path): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "__pycache__" not in str(path)
    }


def test_the_sentence_comes_first_then_effects_ties_errors_and_files(run: Run, folder: Path, fake: Fake) -> None:
    result = run("diagnose", "slide.xml", "a.csv", "b.csv", "--holdout", "c.csv", "--out", "out", "--seed", "3")
    assert result.exit_code == 0
    assert result.stdout.startswith("Coulomb friction at joint slide explains 91 % of the mismatch.\n")
    text = " ".join(result.stdout.replace("\u00a0", " ").split())
    for words in (
        "│ coulomb_friction │ 91 % │ 98 % │ level 0.312 N (0.293 to 0.331) │",
        "│ actuator_gain │ 7 % │ 52 % │ gain 0.83 │",
        "periods 7.00 1/turn (6.90 to",
        "Tie: actuator_gain at actuator:push cannot be told from payload_mass at body:cart by these recordings.",
        "Fitted along and not named: armature_error at joint:slide.",
        "Each recording left out in turn: 2 of 2.",
        "Not explained: 2 % of the mismatch.",
        "one step (0.1 s) │ 0.2 │ 0.02 │ 0.019",
        f"free run │ 2.4 │ {MISSING} │ 0.002",
        "Next recording: a heavier load moves both apart Controls: next.csv.",
        "out holds corrected.xml, diagnosis.json, report.html, settings.json.",
        "See out/report.html.",
    ):
        assert words in text
    assert "a.csv: [bold]Columns[/] left out: x." in result.stderr
    assert {path.name for path in (folder / "out").iterdir()} == RESULTS
    assert fake.found["sentence"] in (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert json.loads((folder / "out" / "settings.json").read_text())["holdout"] == ["c.csv"]
    (call,) = fake.calls
    assert call["model"] == Path("slide.xml")
    assert [recording.name for recording in (*call["fit"], *call["test"])] == ["a.csv", "b.csv", "c.csv"]
    assert (call["seed"], call["nthread"]) == (3, 0)


@pytest.mark.parametrize(
    ("share", "words"),
    [
        (0.033, "Nothing explains it; the effects that come closest leave 3.3 % of the mismatch."),
        (1.0, "Not explained: 100 % of the mismatch."),
    ],
)
def test_without_a_name_it_is_said_what_comes_closest_leaves(run: Run, folder: Path, fake: Fake, share, words) -> None:
    fake.found |= {"verdict": "unknown", "effects": [], "unexplained": {"share": share, "white": False}}
    assert words in run("diagnose", "slide.xml", "a.csv").stdout.replace("\u00a0", " ")


def test_what_is_said_early_is_not_said_again(run: Run, folder: Path, fake: Fake) -> None:
    fake.found["notes"] = ["No ctrl.drive; taken as 0.", "The search ended early."]
    fake.early = ("No ctrl.drive; taken as 0.",)
    shown = run("diagnose", "slide.xml", "a.csv", "b.csv", "--out", "out").stderr
    assert shown.count("taken as 0") == shown.count("ended early") == 1
    assert shown.index("taken as 0") < shown.index("ended early")


def test_what_the_simulator_has_too_much_of_is_not_called_missing(run: Run, folder: Path, fake: Fake) -> None:
    assert "Missing in the simulator" in run("diagnose", "slide.xml", "a.csv").stdout
    fake.found["effects"][0]["too_much"] = True
    text = run("diagnose", "slide.xml", "a.csv").stdout
    assert "Wrong in the simulator" in text
    assert "Missing" not in text
    assert text.count("too much in the simulator") == 1


@pytest.mark.parametrize("verdict", ["none", "unknown"])
def test_no_effects_give_no_tables(run: Run, folder: Path, fake: Fake, verdict: str) -> None:
    fake.found = plain(verdict)
    result = run("diagnose", "slide.xml", "a.csv", "--threads", "2")
    assert result.exit_code == 0
    assert result.stdout.startswith(f"This is {verdict}.\nDone in ")
    assert "│" not in result.stdout
    assert fake.calls[0]["nthread"] == 2


@pytest.mark.parametrize(("effects", "columns"), [([], "simulator"), (named()["effects"], "before")])
def test_errors_before_and_after_are_told_where_something_was_corrected(
    run: Run, folder: Path, fake: Fake, effects: list[dict[str, Any]], columns: str
) -> None:
    error = {"before": 0.2, "after": 0.1 if effects else 0.2, "noise": 0.05}
    held_out = {"fit": {"holdout": {"free_run": error, "one_step": error}}}
    fake.found = plain("named" if effects else "unknown") | {"effects": effects} | held_out
    text = run("diagnose", "slide.xml", "a.csv").stdout
    assert columns in text
    assert ("after" in text) == bool(effects)


def test_by_default_every_diagnosis_has_a_folder_of_its_own(run: Run, folder: Path, fake: Fake) -> None:
    for _ in range(3):
        assert run("diagnose", "slide.xml", "a.csv").exit_code == 0
    folders = sorted(path.name for path in (folder / "runs").iterdir())
    assert folders == ["diagnose-slide", "diagnose-slide-2", "diagnose-slide-3"]
    assert all({path.name for path in (folder / "runs" / name).iterdir()} == RESULTS for name in folders)


def test_earlier_results_are_kept_and_other_files_do_not_matter(run: Run, folder: Path, fake: Fake) -> None:
    assert run("diagnose", "slide.xml", "a.csv", "--out", ".").exit_code == 0
    before = listing(folder)
    result = run("diagnose", "slide.xml", "b.csv", "--out", ".")
    assert result.exit_code == 2
    assert "holds earlier results (corrected.xml, diagnosis.json, report.html, settings.json)" in result.output
    assert listing(folder) == before
    assert len(fake.calls) == 1


def test_ctrl_c_leaves_nothing(run: Run, folder: Path, fake: Fake) -> None:
    before, fake.error = listing(folder), KeyboardInterrupt()
    result = run("diagnose", "slide.xml", "a.csv", "--out", "out")
    assert (result.exit_code, result.stderr) == (130, "Interrupted.\n")
    assert listing(folder) == before
    assert not (folder / "out").exists()


def test_ctrl_c_after_a_stage_says_how_it_goes_on(run: Run, folder: Path, fake: Fake) -> None:
    fake.keeps, fake.error = True, KeyboardInterrupt()
    for name, words in (("out", ["--out", "out"]), ("runs/diagnose-slide", [])):
        result = run("diagnose", "slide.xml", "a.csv", *words)
        said = f"Interrupted. {name} keeps what is done: the same command goes on from there.\n"
        assert (result.exit_code, result.stderr, result.stdout) == (130, said, "")
        assert [path.name for path in (folder / name).iterdir()] == [".progress"]
    fake.error = None
    for name, words in (("out", ["--out", "out"]), ("runs/diagnose-slide", [])):
        result = run("diagnose", "slide.xml", "a.csv", *words)
        assert result.exit_code == 0
        assert result.stderr.startswith("Going on from an interrupted call: naming is done.\n")
        assert {path.name for path in (folder / name).iterdir()} == RESULTS
    assert len(list((folder / "runs").iterdir())) == 1


def test_other_input_leaves_the_progress_of_an_interrupted_call_alone(run: Run, folder: Path, fake: Fake) -> None:
    fake.keeps, fake.error = True, KeyboardInterrupt()
    assert run("diagnose", "slide.xml", "a.csv").exit_code == 130
    kept = (folder / "runs" / "diagnose-slide" / ".progress").read_bytes()
    fake.key, fake.error = "other", None
    result = run("diagnose", "slide.xml", "b.csv")
    assert result.exit_code == 0
    assert "Going on" not in result.stderr
    assert (folder / "runs" / "diagnose-slide" / ".progress").read_bytes() == kept
    assert {path.name for path in (folder / "runs" / "diagnose-slide-2").iterdir()} == RESULTS
    fake.key = "k"
    assert "Going on" in run("diagnose", "slide.xml", "a.csv").stderr
    assert {path.name for path in (folder / "runs" / "diagnose-slide").iterdir()} == RESULTS


def test_an_interruption_between_two_results_is_none_of_earlier_results(run: Run, folder: Path, fake: Fake) -> None:
    fake.keeps, fake.saved = True, KeyboardInterrupt()
    assert run("diagnose", "slide.xml", "a.csv", "--out", "out").exit_code == 130
    assert {path.name for path in (folder / "out").iterdir()} == {".progress", "diagnosis.json"}
    fake.saved = None
    assert run("diagnose", "slide.xml", "a.csv", "--out", "out").exit_code == 0
    assert {path.name for path in (folder / "out").iterdir()} == RESULTS
    (folder / "out" / ".progress").touch()
    assert run("diagnose", "slide.xml", "a.csv", "--out", "out").exit_code == 2


def test_an_interrupted_diagnosis_goes_on_to_the_same_results(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    change(folder, lambda table: table.head(250), "short.csv")
    words = ("diagnose", "slide.xml", "short.csv", "--threads", "1")
    heard: list[str] = []

    def tell(_: object, stage: str, done: float | None = None) -> None:
        heard.append(stage)
        if stage == "weighing the evidence" and heard.count(stage) == 1:
            raise KeyboardInterrupt

    monkeypatch.setattr("torch_activegp.cli.progress.StageProgress.tell", tell)
    assert run(*words, "--out", "cut").exit_code == 130
    tried = sum(stage.startswith("testing") for stage in heard)
    again = run(*words, "--out", "cut")
    assert again.exit_code == 0
    assert sum(stage.startswith("testing") for stage in heard) == tried > 0
    assert run(*words, "--out", "whole").exit_code == 0
    names = {path.name for path in (folder / "whole").iterdir()}
    assert {path.name for path in (folder / "cut").iterdir()} == names
    for name in names - {"settings.json"}:
        assert (folder / "cut" / name).read_bytes() == (folder / "whole" / name).read_bytes(), name


def test_an_error_while_diagnosing_is_one_message_and_leaves_nothing(run: Run, folder: Path, fake: Fake) -> None:
    before, fake.error = listing(folder), DataError("a.csv: no excitation.")
    result = run("diagnose", "slide.xml", "a.csv")
    assert (result.exit_code, result.stderr, result.stdout) == (2, "Error: a.csv: no excitation.\n", "")
    assert listing(folder) == before


def test_a_result_that_cannot_be_reported_is_not_lost(run: Run, folder: Path, fake: Fake) -> None:
    fake.found = {**named(), "verdict": "perhaps"}
    result = run("diagnose", "slide.xml", "a.csv", "--out", "out")
    assert result.exit_code == 2
    assert json.loads((folder / "out" / "diagnosis.json").read_text())["verdict"] == "perhaps"


@pytest.mark.parametrize(
    ("model", "recording", "joints"),
    [
        ("emps", "emps:test", {"slide"}),
        ("multiarm", "multiarm:test", {"arm"}),
        ("laas", "laas:speed_test", {"rotor"}),
        ("balls", "balls:golf_ball_1", {"height"}),
    ],
)
def test_public_data_by_name(
    run: Run, folder: Path, fake: Fake, recordings_dir: Path, model: str, recording: str, joints: set[str]
) -> None:
    assert run("diagnose", model, recording, "--out", "out").exit_code == 0
    (call,) = fake.calls
    assert call["model"].is_file()
    assert {joint for one in call["fit"] for joint in one.joints} == joints


def test_a_factory_and_a_column_map(run: Run, folder: Path, fake: Fake) -> None:
    change(folder, lambda table: table.set_axis(["t", "x", "u"], axis=1), "raw.csv")
    (folder / "map.toml").write_text('time = "t"\nqpos.slide = { column = "x", unit = "mm" }\nctrl.push = "u"\n')
    assert run("diagnose", "machines:real", "raw.csv", "--columns", "map.toml", "--out", "out").exit_code == 0
    (call,) = fake.calls
    assert isinstance(call["model"], Simulator)
    assert call["fit"][0].columns == ("time", "qpos.slide", "ctrl.push")
    assert json.loads((folder / "out" / "settings.json").read_text())["columns"] == "map.toml"


GOOD = ["slide.xml", "a.csv"]
BAD = {
    "no column time": (lambda table: table.drop(columns="time"), "bad.csv: no column `time`"),
    "no position": (lambda table: table.drop(columns="qpos.slide"), "bad.csv: no position"),
    "unknown column": (lambda table: table.assign(angle=0.0), "bad.csv: unknown column `angle`"),
    "time goes back": (
        lambda table: table.assign(time=np.where(table.index == 7, 0.0, table.time)),
        "bad.csv, row 8: `time` goes back from 0.06 s to 0 s",
    ),
    "time stands still": (
        lambda table: table.assign(time=np.where(table.index == 7, 0.06, table.time)),
        "bad.csv, row 8: `time` stands still at 0.06 s",
    ),
    "nan": (
        lambda table: table.assign(**{"qpos.slide": np.where(table.index == 4, np.nan, table["qpos.slide"])}),
        "bad.csv, row 5, column `qpos.slide`: a finite number wanted, found nan",
    ),
    "text": (
        lambda table: table.assign(**{"ctrl.push": np.where(table.index == 4, "high", "1.0")}),
        "bad.csv, row 5, column `ctrl.push`: a number wanted, found 'high'",
    ),
    "unit": (
        lambda table: table.assign(
            **{"qpos.slide": 1e3 * table["qpos.slide"], "qvel.slide": np.gradient(table["qpos.slide"], table.time)}
        ),
        "times as fast as the velocity says, once wanted; the position looks like mm",
    ),
    "3 rows": (lambda table: table.head(3), "bad.csv: too short, 3 rows"),
    "gaps everywhere": (
        lambda table: table.iloc[[0, 1, 2, 50, 51, 52, 100, 101, 102]],
        "bad.csv: too short, no 4 rows without a gap. Gap of 0.48 s after row 3",
    ),
}
"""Refused while loading: how the recording is spoilt, and what is said."""
BAD_FOR_THE_MODEL = {
    "11 rows": (lambda table: table.head(11), "bad.csv: too short, 11 rows"),
    "strange joint": (
        lambda table: table.rename(columns={"qpos.slide": "qpos.elbow"}),
        "bad.csv, column `qpos.elbow`: the model has no joint `elbow`; its joints are slide",
    ),
    "strange actuator": (
        lambda table: table.rename(columns={"ctrl.push": "ctrl.pull"}),
        "bad.csv, column `ctrl.pull`: the model has no actuator `pull`; its actuators are push",
    ),
    "strange force": (lambda table: table.assign(**{"qfrc.elbow": 1.0}), "bad.csv, column `qfrc.elbow`"),
    "constant position": (
        lambda table: table.assign(**{"qpos.slide": 0.3}),
        "bad.csv, column `qpos.slide`: the same value in every row",
    ),
    "no excitation": (
        lambda table: table.assign(
            **{"qpos.slide": 1e-4 * np.random.default_rng(0).standard_normal(len(table)), "ctrl.push": 0.0}
        ),
        "bad.csv: no excitation",
    ),
}
"""Refused where the recording meets the model."""


def refused(run: Run, folder: Path, words: Sequence[str], message: str) -> None:
    before = listing(folder)
    result = run("diagnose", *words)
    assert result.exit_code == 2
    assert message in result.output
    assert len(result.stderr.splitlines()) == 1 or result.stderr.startswith("Usage: ")
    assert result.stdout == ""
    assert listing(folder) == before


@pytest.mark.parametrize("case", BAD)
@pytest.mark.parametrize("role", ["fit", "holdout"])
def test_a_spoilt_recording_gets_one_message_and_exit_code_2(run: Run, folder: Path, case: str, role: str) -> None:
    edit, message = BAD[case]
    change(folder, edit)
    refused(run, folder, ["slide.xml", "bad.csv"] if role == "fit" else [*GOOD, "--holdout", "bad.csv"], message)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.xml", "a.csv"], "Unknown model 'nowhere.xml'. Wanted an MJCF file"),
        (["emsp", "a.csv"], "Unknown model 'emsp': did you mean 'emps'?"),
        (["broken.xml", "a.csv"], "MuJoCo cannot compile `broken.xml`"),
        (["text.xml", "a.csv"], "MuJoCo cannot compile `text.xml`"),
        (["a.csv", "slide.xml"], "MuJoCo cannot compile `a.csv`, by its name no model"),
        ([".", "a.csv"], "Wanted a model, found the folder '.'"),
        (["machines:number", "a.csv"], "wanted a torch_activegp Simulator from `machines:number`, found a int"),
        (["machines:fails", "a.csv"], "`machines:fails` raised KeyError"),
        (["machines:nobody", "a.csv"], "found no `nobody` in module `machines`"),
        (["nobody:make", "a.csv"], "found no module `nobody`"),
        (["slide.xml", "nowhere.csv"], "nowhere.csv: no such file"),
        (["slide.xml", "run*.csv"], "run*.csv: no file matches the pattern"),
        (["slide.xml", "slide.xml"], "slide.xml: cannot read `.xml` files"),
        ([*GOOD, "--holdout", "nowhere.csv"], "nowhere.csv: no such file"),
        ([*GOOD, "--holdout", "a.csv"], "a.csv is both learned from and held out"),
        ([*GOOD, "--holdout", "./a.csv"], "a.csv is both learned from and held out"),
        ([*GOOD, "[ab].csv"], "a.csv is given 2 times"),
        ([*GOOD, "--columns", "nowhere.toml"], "nowhere.toml: no such file"),
        ([*GOOD, "--columns", "slide.xml"], "slide.xml: not a TOML file"),
        (["slide.xml", "emps:trian"], "EMPS has no split `trian`"),
        (["slide.xml", "nobody:train"], "unknown data set `nobody:train`"),
        ([*GOOD, "--out", "slide.xml"], "slide.xml"),
        ([*GOOD, "--threads", "-1"], "--threads"),
        (["slide.xml"], "RECORDING"),
    ],
)
def test_bad_words_get_one_message_and_exit_code_2(run: Run, folder: Path, words: list[str], message: str) -> None:
    refused(run, folder, words, message)


def test_help_teaches(run: Run) -> None:
    output = run("diagnose", "--help").output
    for words in ("torch-activegp diagnose emps emps:train --holdout emps:test", "--columns", "report.html", "--out"):
        assert words in output


@pytest.mark.parametrize("case", BAD_FOR_THE_MODEL)
def test_a_recording_of_another_machine_gets_one_message_and_exit_code_2(run: Run, folder: Path, case: str) -> None:
    edit, message = BAD_FOR_THE_MODEL[case]
    change(folder, edit)
    refused(run, folder, ["slide.xml", "bad.csv"], message)


def test_a_gap_splits_a_run_and_the_report_says_so(run: Run, folder: Path) -> None:
    """Rows 1 to 6 are too few for a run of their own, and the others are still enough."""
    change(folder, lambda table: table.drop(index=[*range(6, 16), *range(300, 340)]), "gaps.csv")
    result = run("diagnose", "slide.xml", "gaps.csv", "--holdout", "c.csv", "--out", "out")
    assert result.exit_code == 0
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    for words in ("Gap of 0.11 s after row 6", "Gap of 0.41 s after row 290"):
        assert words in page
        assert words in result.stderr


def test_a_simulator_from_a_factory_is_diagnosed(run: Run, folder: Path) -> None:
    (folder / "slides.py").write_text(
        "from torch_activegp.simulators import MujocoSimulator\ndef make(): return MujocoSimulator('slide.xml')\n"
    )
    change(folder, lambda table: table.head(60), "short.csv")
    assert run("diagnose", "slides:make", "short.csv", "--out", "out").exit_code == 0
    assert (folder / "out" / "diagnosis.json").is_file()


def test_the_friction_of_a_slide_is_named(run: Run, folder: Path) -> None:
    result = run("diagnose", "slide.xml", "a.csv", "--holdout", "c.csv", "--out", "out")
    assert result.exit_code == 0
    found = json.loads((folder / "out" / "diagnosis.json").read_text())
    assert {effect["name"]: effect["target"] for effect in found["effects"]} == {
        "coulomb_friction": "joint:slide",
        "viscous_friction": "joint:slide",
    }
    free_run = found["fit"]["holdout"]["free_run"]
    assert free_run["after"] < free_run["before"] / 10
    assert result.stdout.startswith(found["sentence"])
    corrected = mujoco.MjModel.from_xml_path(str(folder / "out" / "corrected.xml"))
    assert corrected.dof_frictionloss[0] == pytest.approx(0.5, rel=0.1)
