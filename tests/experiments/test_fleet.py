from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from torch_activegp.data import ColumnMap, Recording
from torch_activegp.diagnosis import Diagnosis
from torch_activegp.errors import ActiveGPError, ConfigurationError, DataError
from torch_activegp.experiments.demo import MODEL, Secret, record
from torch_activegp.experiments.fleet import Job, diagnose_all

TIME = np.arange(12) * 0.1
TABLE = pd.DataFrame({"time": TIME, "qpos.elbow": np.sin(TIME), "ctrl.motor": np.cos(TIME)})


def machine(folder: Path, *names: str) -> Path:
    folder.mkdir()
    for name in names:
        path = folder / name
        if name.endswith(".csv"):
            TABLE.to_csv(path, index=False)
        elif name.endswith(".npz"):
            np.savez(path, **{column: TABLE[column].to_numpy() for column in TABLE})
        elif name.endswith("/"):
            Recording.from_columns("run", dict(TABLE)).data.memmap(path)
        else:
            path.write_text(MODEL if name.endswith(".xml") else "")
    return folder


def test_a_folder_is_a_machine_with_whatever_can_be_read(tmp_path: Path) -> None:
    names = ("arm.XML", "b.csv", "a.npz", "memory/", "test_1.csv", "Holdout.npz", "readme.md", ".hidden.csv")
    folder = machine(tmp_path / "arm", *(name.replace(".XML", ".xml") for name in names))
    (folder / "meshes").mkdir()
    (folder / "arm.xml").rename(folder / "arm.XML")
    job = Job.from_folder(str(folder))
    assert job.model == folder / "arm.XML"
    assert job.recordings == [folder / name for name in ("a.npz", "b.csv", "memory")]
    assert job.holdout == [folder / name for name in ("Holdout.npz", "test_1.csv")]
    fit, test = job.load()
    assert [run.name for run in (*fit, *test)] == ["a.npz", "b.csv", "memory", "Holdout.npz", "test_1.csv"]


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), r"arm: one MJCF file \*.xml wanted, found none"),
        (("a.csv", "b.xml", "c.xml"), r"arm: one MJCF file \*.xml wanted, found b.xml, c.xml. Keep one machine"),
        (("a.xml", "readme.md"), "arm: no recording to fit. Wanted files that end in .csv, .tsv, .*, .mat and begin"),
        (("a.xml", "test.csv"), r"arm: no recording to fit, only held-out ones \(test.csv\)"),
    ],
)
def test_a_folder_that_is_no_machine(tmp_path: Path, names: Sequence[str], message: str) -> None:
    folder = machine(tmp_path / "arm", *names)
    with pytest.raises(DataError, match=message):
        Job.from_folder(folder)


def test_no_folder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="nowhere: cannot be read as a folder: No such file or directory"):
        Job.from_folder(tmp_path / "nowhere")


def test_recordings_in_memory_come_before_files_and_files_take_the_column_map(tmp_path: Path) -> None:
    machine(tmp_path / "arm", "a.csv", "b.csv")
    TABLE.rename(columns={"qpos.elbow": "angle"}).to_csv(tmp_path / "arm" / "a.csv", index=False)
    columns = ColumnMap.from_mapping({"time": "time", "qpos.shoulder": "angle", "ctrl.motor": "ctrl.motor"})
    inside = Recording.from_columns("inside", dict(TABLE))
    fit, test = Job("model", [tmp_path / "arm" / "a.csv", inside], [inside], columns).load()
    assert [run.name for run in fit] == ["inside", "a.csv"]
    assert fit[1].joints == ("shoulder",)
    assert test == [inside]


def test_files_are_fitted_or_held_out(tmp_path: Path) -> None:
    path = machine(tmp_path / "arm", "a.csv") / "a.csv"
    with pytest.raises(DataError, match="a.csv is both learned from and held out"):
        Job("model", [path], [str(path)]).load()


def test_each_gets_one_thread_the_seed_and_a_voice_and_its_failure_is_its_own(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    calls: list[dict[str, Any]] = []
    heard: list[tuple[str, str, float | None]] = []

    def fake(model: Any, fit: Any, test: Any, *, seed: int, nthread: int, tell: Any) -> str:
        tell("naming", 0.5)
        calls.append({"model": model, "fit": fit, "test": test, "seed": seed, "nthread": nthread})
        if isinstance(model, Exception):
            raise model
        return f"diagnosis of {model}"

    monkeypatch.setattr("torch_activegp.diagnosis.diagnose", fake)
    run = Recording.from_columns("run", dict(TABLE))
    machines = {
        "lost": Job("lost", [tmp_path / "nowhere.csv"]),
        "broken": Job(ConfigurationError("does not compile"), [run]),
        "odd": Job(ZeroDivisionError("by zero"), [run]),
        "arm": Job("arm", [run], [run]),
    }
    found = dict(diagnose_all(machines, jobs=1, seed=3, tell=lambda *words: heard.append(words)))
    assert list(found) == list(machines)
    assert isinstance(found["lost"], DataError)
    assert str(found["broken"]) == "does not compile"
    assert str(found["odd"]).startswith("failed with ZeroDivisionError: by zero. This should not happen;")
    assert found["arm"] == "diagnosis of arm"
    assert calls[-1] == {"model": "arm", "fit": [run], "test": [run], "seed": 3, "nthread": 1}
    assert heard == [(name, "naming", 0.5) for name in ("broken", "odd", "arm")]


@pytest.mark.parametrize(
    ("arguments", "message"), [({"seed": -1}, "seed: 0 or a pos"), ({"jobs": -2}, "jobs"), ({"backend": "x"}, "loky")]
)
def test_arguments_out_of_range_are_refused_at_once(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        diagnose_all({}, **arguments)


def test_two_machines_in_two_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A spring by its file's name, from the working folder; a broken model beside it."""
    monkeypatch.chdir(tmp_path)
    Path("arm.xml").write_text(MODEL)
    rng = np.random.default_rng(0)
    for name in ("a", "test"):
        record(Secret("linear_spring", value=0.05), rng).to_csv(f"{name}.csv", index=False)
    broken = Job("<mujoco><worldbody>", [Recording.from_columns("run", dict(TABLE))])
    stages: list[tuple[str, str, float | None]] = []
    machines = {"arm": Job("arm.xml", ["a.csv"], ["test.csv"]), "broken": broken}
    found = dict(diagnose_all(machines, jobs=2, tell=lambda *words: stages.append(words)))
    diagnosis = found["arm"]
    assert isinstance(diagnosis, Diagnosis)
    assert [(effect.name, effect.target) for effect in diagnosis.effects] == [("linear_spring", "joint:pivot")]
    assert diagnosis.corrected is not None
    assert isinstance(found["broken"], ActiveGPError)
    assert ("arm", "reading", 0.0) in stages
    assert os.getcwd() == str(tmp_path)
