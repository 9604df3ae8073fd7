from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
from typer.testing import Result

from torch_activegp.data import Recording
from torch_activegp.errors import DataError
from torch_activegp.report.numbers import MISSING
from torch_activegp.simulators import Simulator

Run = Callable[..., Result]

ERRORS = {
    "runs": [
        {
            "run": f"{name}.csv",
            "channel": "qpos.hip",
            "one_step": {"error": 0.02, "noise": 0.019},
            "free_run": {"error": 2.4 if name == "a" else None, "noise": 0.0021},
        }
        for name in "ab"
    ],
    "one_step": {"error": 0.02, "noise": 0.019},
    "free_run": {"error": None, "noise": 0.0021},
    "notes": ["b.csv: no ctrl.m; taken as [bold]0[/]."],
}


@pytest.fixture(autouse=True)
def files(folder: Path) -> None:
    """Two recordings of nothing in particular."""
    rows = "".join(f"{0.01 * row:.2f},{0.001 * row * row}\n" for row in range(40))
    for name in "ab":
        (folder / f"{name}.csv").write_text("time,qpos.hip\n" + rows)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, list[str]]]:
    """Puts a fake in place of the evaluation; what it was called with."""
    heard: list[tuple[Any, list[str]]] = []

    def evaluate(model: Path | Simulator, recordings: Sequence[Recording]) -> dict[str, Any]:
        heard.append((model, [recording.name for recording in recordings]))
        return ERRORS

    monkeypatch.setattr("torch_activegp.diagnosis.evaluate", evaluate, raising=False)
    return heard


def test_the_errors_are_a_table_and_a_file(run: Run, folder: Path, calls: list[tuple[Any, list[str]]]) -> None:
    result = run("evaluate", "rod.xml", "a.csv", "b.csv", "--out", "errors/rod.json")
    assert result.exit_code == 0
    text = " ".join(result.stdout.split())
    for words in (
        "Errors of rod.xml",
        "a.csv │ qpos.hip │ 0.02 │ 0.019 │ 2.4 │ 0.0021",
        f"b.csv │ qpos.hip │ 0.02 │ 0.019 │ {MISSING} │ 0.0021",
        f"all │ │ 0.02 │ 0.019 │ {MISSING} │ 0.0021",
        "See errors/rod.json.",
    ):
        assert words in text
    assert result.stderr == "b.csv: no ctrl.m; taken as [bold]0[/].\n"
    assert calls == [(Path("rod.xml"), ["a.csv", "b.csv"])]
    assert json.loads((folder / "errors" / "rod.json").read_text()) == ERRORS


def test_without_out_nothing_is_written(run: Run, folder: Path, calls: list[tuple[Any, list[str]]]) -> None:
    before = sorted(folder.rglob("*"))
    result = run("evaluate", "rod.xml", "*.csv")
    assert result.exit_code == 0
    assert calls[0][1] == ["a.csv", "b.csv"]
    assert sorted(folder.rglob("*")) == before


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nowhere.xml", "a.csv"], "Unknown model 'nowhere.xml'"),
        (["rod.xml", "nowhere.csv"], "nowhere.csv: no such file"),
        (["rod.xml", "a.csv", "--columns", "nowhere.toml"], "nowhere.toml: no such file"),
        (["rod.xml", "a.csv", "a.csv"], "a.csv is given 2 times"),
        (["rod.xml", "a.csv", "--out", "b.csv"], "b.csv is there already, and no file is ever overwritten"),
        (["rod.xml", "a.csv", "--out", "b.csv/c.json"], "found the file b.csv"),
        (["rod.xml"], "RECORDING"),
    ],
)
def test_bad_input_gets_one_message_and_exit_code_2(
    run: Run, folder: Path, calls: list[tuple[Any, list[str]]], words: list[str], message: str
) -> None:
    before = sorted(folder.rglob("*"))
    result = run("evaluate", *words)
    assert result.exit_code == 2
    assert message in result.output
    assert result.output.count("Error") <= 1
    assert sorted(folder.rglob("*")) == before
    assert not calls


@pytest.mark.parametrize(
    ("prescribed", "message"),
    [
        ('"hip"', "map.toml: `prescribed` wants names of joints"),
        ('["table"]', "a.csv: no column `qpos.table`, and `table` is said to be prescribed"),
        ('["hip"]', "all of them are prescribed (hip)"),
    ],
)
def test_a_map_that_prescribes_the_wrong_joint_gets_one_message(
    run: Run, folder: Path, prescribed: str, message: str
) -> None:
    (folder / "map.toml").write_text(f"prescribed = {prescribed}\n")
    result = run("evaluate", "rod.xml", "a.csv", "--columns", "map.toml")
    assert result.exit_code == 2
    assert message in result.stderr.replace("\n", " ")
    assert result.stderr.count("Error") == 1


def test_an_error_while_forecasting_is_one_message(run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def evaluate(*_: object) -> dict[str, Any]:
        raise DataError("a.csv: the model has no joint `hip`.")

    monkeypatch.setattr("torch_activegp.diagnosis.evaluate", evaluate, raising=False)
    result = run("evaluate", "rod.xml", "a.csv", "--out", "errors.json")
    assert (result.exit_code, result.stderr) == (2, "Error: a.csv: the model has no joint `hip`.\n")
    assert not (folder / "errors.json").exists()


def test_the_true_model_forecasts_down_to_the_noise_and_a_wrong_one_does_not(run: Run, folder: Path) -> None:
    if not hasattr(importlib.import_module("torch_activegp.diagnosis"), "evaluate"):
        pytest.skip("no evaluation yet")
    model = mujoco.MjModel.from_xml_path("rod.xml")
    data, time = mujoco.MjData(model), np.arange(1000) * model.opt.timestep
    random = np.random.default_rng(0)
    control = np.sin(5.0 * time)
    position = np.empty_like(time)
    for row, torque in enumerate(control):
        position[row], data.ctrl[0] = data.qpos[0] + 1e-3 * random.standard_normal(), torque
        mujoco.mj_step(model, data)
    pd.DataFrame({"time": time, "qpos.hip": position, "ctrl.m": control}).to_csv("swing.csv", index=False)
    found = {}
    for name in ("rod", "weak_rod"):
        assert run("evaluate", f"{name}.xml", "swing.csv", "--out", f"{name}.json").exit_code == 0
        found[name] = json.loads((folder / f"{name}.json").read_text())
        (entry,) = found[name]["runs"]
        assert (entry["run"], entry["channel"]) == ("swing.csv", "qpos.hip")
    noise = 1e-3 / position.std()
    right, wrong = (found[name]["free_run"] for name in ("rod", "weak_rod"))
    assert right["noise"] == pytest.approx(noise, rel=0.2)
    assert right["error"] == pytest.approx(noise, rel=0.2)
    assert wrong["error"] > 10 * right["error"]


def test_help_teaches(run: Run) -> None:
    output = run("evaluate", "--help").output
    for words in ("torch-activegp evaluate emps emps:test", "corrected.xml", "--columns", "--out"):
        assert words in output


def test_degrees_are_refused_as_a_diagnosis_does(run: Run, folder: Path) -> None:
    time = np.arange(400) * 0.01
    degrees = 30.0 * np.sin(3.0 * time)
    pd.DataFrame({"time": time, "qpos.hip": degrees, "ctrl.m": np.sin(time)}).to_csv("deg.csv", index=False)
    for command in ("evaluate", "diagnose"):
        result = run(command, "rod.xml", "deg.csv")
        assert result.exit_code == 2
        assert "deg.csv, column `qpos.hip`: rad or m wanted" in result.stderr.replace("\n", " ")
