from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from torch_activegp.data import Recording

Run = Callable[..., Result]
INPUTS = {"model.xml", "test1.csv", "test2.csv", *(f"run{number}.csv" for number in range(1, 7))}
DRAG = {
    "name": "quadratic_drag",
    "target": "joint:pivot",
    "share": 0.97,
    "probability": 0.98,
    "parameters": {"coefficient": {"value": 0.0029, "unit": "N m s2/rad2", "ci95": [0.0028, 0.003]}},
    "ties": [],
}
ERRORS = {"before": 0.05, "after": 0.0021, "noise": 0.002}


class Fake:
    """Stands in for the diagnosis."""

    sentence = "The simulator leaves out quadratic_drag."
    evidence: dict[str, Any] = {}  # noqa: RUF012

    def __init__(self) -> None:
        self.effects: list[dict[str, Any]] = [DRAG]
        self.calls: list[tuple[Path, int, int, int]] = []
        self.error: BaseException | None = None

    def __call__(
        self, model: Path, fit: Sequence[Recording], test: Sequence[Recording], *, nthread: int, tell: Any
    ) -> Fake:
        tell("naming", None)
        assert {path.name for path in model.parent.iterdir()} == INPUTS
        self.calls.append((model, len(fit), len(test), nthread))
        if self.error is not None:
            raise self.error
        return self

    def to_dict(self) -> dict[str, Any]:
        holdout = {"one_step": ERRORS, "free_run": ERRORS}
        verdict = "named" if self.effects else "none"
        return {"verdict": verdict, "sentence": self.sentence, "effects": self.effects, "fit": {"holdout": holdout}}

    def save(self, folder: Path) -> None:
        (folder / "diagnosis.json").write_text(json.dumps(self.to_dict()))


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Fake:
    made = Fake()
    monkeypatch.setattr("torch_activegp.diagnosis.diagnose", made)
    return made


def test_the_verdict_comes_first_and_the_key_last(run: Run, folder: Path, fake: Fake) -> None:
    result = run("demo", "--seed", "9", "--threads", "1", "--out", "out")
    assert result.exit_code == 0
    wanted = [
        fake.sentence,
        "N m s2/rad2",
        "Hidden was quadratic_drag at joint:pivot, coefficient 0.00286 N m s2/rad2 (seed 9). Right.",
        "noise",
        "0.0021",
        "Done in ",
        f"See {Path('out') / 'report.html'}.",
    ]
    places = [result.stdout.index(words) for words in wanted]
    assert places == sorted(places)
    assert places[0] == 0
    assert fake.calls == [(Path("out") / "model.xml", 6, 2, 1)]
    assert {path.name for path in (folder / "out").iterdir()} == INPUTS | {"diagnosis.json", "report.html", "key.json"}
    key = json.loads((folder / "out" / "key.json").read_text())
    assert (key["seed"], key["name"]) == (9, "quadratic_drag")


def test_without_a_seed_each_demo_differs(run: Run, folder: Path, fake: Fake) -> None:
    results = [run("demo") for _ in range(2)]
    assert [result.exit_code for result in results] == [0, 0]
    folders = sorted((folder / "runs").iterdir())
    assert [path.name for path in folders] == ["demo", "demo-2"]
    seeds = [json.loads((path / "key.json").read_text())["seed"] for path in folders]
    assert seeds[0] != seeds[1]
    assert [f"Seed {seed}: " in result.stderr for seed, result in zip(seeds, results, strict=True)] == [True, True]


def test_without_effects_there_is_no_table_of_them(run: Run, folder: Path, fake: Fake) -> None:
    fake.effects = []
    result = run("demo", "--seed", "23", "--out", "out")
    assert "Missing in the simulator" not in result.stdout
    assert "Hidden was nothing (seed 23). Right." in result.stdout


def test_earlier_results_are_kept(run: Run, folder: Path, fake: Fake) -> None:
    result = run("demo", "--out", ".")
    assert result.exit_code == 2
    assert "Choose another --out" in result.stderr
    assert fake.calls == []


def test_ctrl_c_keeps_the_recordings_and_no_key(run: Run, folder: Path, fake: Fake) -> None:
    fake.error = KeyboardInterrupt()
    result = run("demo", "--out", "out")
    assert result.exit_code == 130
    assert {path.name for path in (folder / "out").iterdir()} == INPUTS


def test_help_teaches_in_eighty_columns(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("TERMINAL_WIDTH", "80")
    result = run("demo", "--help")
    for words in ("torch-activegp demo", "--seed", "report.html", "key.json"):
        assert words in result.output
    assert max(map(len, result.output.splitlines())) <= 80


def test_nothing_hidden_is_nothing_found(run: Run, folder: Path) -> None:
    result = run("demo", "--seed", "23", "--out", "out")
    assert result.stdout.startswith("The simulator and the recordings differ by noise alone.\n")
    assert "Hidden was nothing (seed 23). Right." in result.stdout
    assert "noise alone" in (folder / "out" / "report.html").read_text(encoding="utf-8")
