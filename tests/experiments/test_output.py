from __future__ import annotations

import json
import math
from pathlib import Path

import pandas as pd
import pytest

from torch_activegp.errors import ActiveGPError, CheckpointError, ConfigurationError
from torch_activegp.experiments import output
from torch_activegp.experiments.output import atomic, check_output, open_output, write_json, write_table, write_text

SETTINGS = {"seed": 1, "episodes": 3, "methods": ["a"], "bounds": {"x": (-1.0, 1.0)}}
MAY_GROW = ("episodes", "methods")


def test_a_new_or_empty_folder_gets_the_settings(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "a" / "b"):
        assert open_output(folder, SETTINGS, resume=False) == folder
        assert json.loads((folder / "settings.json").read_text())["episodes"] == 3


def test_checking_writes_nothing(tmp_path: Path) -> None:
    check_output(tmp_path / "new" / "deep", SETTINGS, resume=False)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("resume", [True, False])
def test_a_folder_of_something_else_is_refused(tmp_path: Path, resume: bool) -> None:
    (tmp_path / "thesis.txt").write_text("dear to me")
    with pytest.raises(ActiveGPError, match="no run to resume" if resume else "is not empty.*--resume"):
        open_output(tmp_path, SETTINGS, resume=resume)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_the_same_run_can_be_resumed_and_may_grow(tmp_path: Path) -> None:
    open_output(tmp_path, SETTINGS, resume=True)
    open_output(tmp_path, SETTINGS, resume=True, may_grow=MAY_GROW)
    open_output(tmp_path, {**SETTINGS, "episodes": 5, "methods": ["b", "a"]}, resume=True, may_grow=MAY_GROW)
    assert json.loads((tmp_path / "settings.json").read_text())["episodes"] == 5
    with pytest.raises(CheckpointError, match="episodes: 5 there, 4 now.*only episodes, methods may grow"):
        open_output(tmp_path, {**SETTINGS, "episodes": 4, "methods": ["a", "b"]}, resume=True, may_grow=MAY_GROW)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 2}, "seed: 1 there, 2 now"),
        ({"episodes": 2}, "episodes: 3 there, 2 now"),
        ({"methods": ["b"]}, "methods:"),
        ({"bounds": {}}, "bounds:"),
        ({"steps": 4}, "steps: None there, 4 now"),
        ({"episodes": "many"}, "episodes"),
    ],
)
def test_other_settings_are_refused(tmp_path: Path, change: dict[str, object], message: str) -> None:
    open_output(tmp_path, SETTINGS, resume=False)
    with pytest.raises(CheckpointError, match=message):
        open_output(tmp_path, {**SETTINGS, **change}, resume=True, may_grow=MAY_GROW)


@pytest.mark.parametrize("text", ["{", "3", "\xff"])
def test_damaged_settings_are_reported(tmp_path: Path, text: str) -> None:
    (tmp_path / "settings.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(CheckpointError, match="settings.json is damaged"):
        open_output(tmp_path, SETTINGS, resume=True)


def test_a_place_that_cannot_be_written_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    file.write_text("")
    with pytest.raises(ConfigurationError, match="found the file"):
        check_output(file, SETTINGS, resume=False)
    with pytest.raises(ConfigurationError, match=f"{file} is a file"):
        check_output(file / "below", SETTINGS, resume=False)
    monkeypatch.setattr(output.os, "access", lambda path, mode: False)
    with pytest.raises(ConfigurationError, match=f"{tmp_path} cannot be written"):
        check_output(tmp_path / "new", SETTINGS, resume=False)


def test_a_full_disk_leaves_the_earlier_file_and_no_litter(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "earlier")
    with pytest.raises(ConfigurationError, match=r"Cannot write to .*a.txt: No space left"), atomic(path) as file:
        file.write(b"half")
        raise OSError(28, "No space left on device")
    assert path.read_text() == "earlier"
    assert list(tmp_path.iterdir()) == [path]


def test_numbers_keep_every_bit(tmp_path: Path) -> None:
    values = [math.pi, 1e-300, 0.1 + 0.2, 1.0]
    write_table(tmp_path / "t.csv", pd.DataFrame({"x": values}))
    lines = (tmp_path / "t.csv").read_bytes().decode().split("\n")
    assert [float(line) for line in lines[1:-1]] == values
    write_json(tmp_path / "t.json", {"x": values})
    assert json.loads((tmp_path / "t.json").read_text()) == {"x": values}


def test_a_place_that_takes_no_folder_is_reported_whatever_its_rights(tmp_path: Path, monkeypatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("torch_activegp.experiments.output.tempfile.TemporaryDirectory", fails)
    with pytest.raises(ConfigurationError, match=r"Cannot make the output folder .*: Read-only file system in "):
        check_output(tmp_path / "out", {}, resume=False)
