"""Checkpoints are whole or absent, and belong to one run."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from torch_activegp.errors import CheckpointError, ConfigurationError
from torch_activegp.loops.checkpoint import check_plain, load_checkpoint, save_checkpoint

SETTINGS = {"task": "pendulum", "seed": 3, "beta": 0.1, "sizes": (1, 2), "more": {"a": [None, True]}}
CONTENT = {"state": {"w": torch.arange(5.0, dtype=torch.float64) / 3}, "records": [{"mse": 0.1}]}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "new" / "folder" / "run.pt"


def test_what_is_saved_is_read(path: Path) -> None:
    save_checkpoint(path, SETTINGS, CONTENT)
    content = load_checkpoint(path, SETTINGS)
    assert torch.equal(content["state"]["w"], CONTENT["state"]["w"])
    assert content["records"] == CONTENT["records"]
    assert os.listdir(path.parent) == ["run.pt"]


def test_a_later_save_replaces_the_earlier(path: Path) -> None:
    save_checkpoint(path, SETTINGS, CONTENT)
    save_checkpoint(path, SETTINGS, {"records": []})
    assert load_checkpoint(path, SETTINGS)["records"] == []


@pytest.mark.parametrize("where", ["torch.save", "os.fsync", "torch.load", "os.replace"])
def test_a_failure_while_writing_leaves_the_earlier_file(
    path: Path, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_checkpoint(path, SETTINGS, CONTENT)
    before = path.read_bytes()

    def fail(*args: Any, **kwargs: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(where, fail)
        with pytest.raises(CheckpointError, match="could not be written .*No space left.*an earlier one is as it was"):
            save_checkpoint(path, SETTINGS, {"records": []})
    assert path.read_bytes() == before
    assert os.listdir(path.parent) == ["run.pt"]
    assert load_checkpoint(path, SETTINGS)["records"] == CONTENT["records"]


def test_a_kill_while_writing_leaves_the_earlier_file(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_checkpoint(path, SETTINGS, CONTENT)

    def die(content: Any, file: Any) -> None:
        file.write(b"half a check")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(torch, "save", die)
        with pytest.raises(KeyboardInterrupt):
            save_checkpoint(path, SETTINGS, {"records": []})
    assert load_checkpoint(path, SETTINGS)["records"] == CONTENT["records"]


@pytest.mark.parametrize(
    "thing", [np.float64(1.0), Path("here"), lambda: None, object()], ids=["numpy", "path", "lambda", "object"]
)
def test_what_could_not_be_read_again_is_not_written(path: Path, thing: Any) -> None:
    save_checkpoint(path, SETTINGS, CONTENT)
    with pytest.raises(CheckpointError, match="state_dict hold tensors and plain values only"):
        save_checkpoint(path, SETTINGS, {"state": thing})
    assert load_checkpoint(path, SETTINGS)["records"] == CONTENT["records"]


def test_a_missing_file_is_an_error(path: Path) -> None:
    with pytest.raises(CheckpointError, match=rf"Wanted a checkpoint at {re.escape(str(path))}, found none"):
        load_checkpoint(path, SETTINGS)


@pytest.mark.parametrize("damage", ["empty", "text", "half", "one byte", "tensor", "list", "no settings", "settings"])
def test_a_damaged_file_is_an_error(path: Path, damage: str) -> None:
    save_checkpoint(path, SETTINGS, CONTENT)
    whole = path.read_bytes()
    spot = whole.index(CONTENT["state"]["w"].numpy().tobytes()) + 9
    for name, value in {"empty": b"", "text": b"hello", "half": whole[: len(whole) // 2]}.items():
        if damage == name:
            path.write_bytes(value)
    if damage == "one byte":
        path.write_bytes(whole[:spot] + bytes([whole[spot] ^ 1]) + whole[spot + 1 :])
    others = {
        "tensor": torch.ones(3),
        "list": [1],
        "no settings": {"version": 1},
        "settings": {"version": 1, "settings": 5},
    }
    if damage in others:
        torch.save(others[damage], path)
    with pytest.raises(CheckpointError, match=r"run.pt is not a readable checkpoint \(.+\). Delete it and start again"):
        load_checkpoint(path, SETTINGS)


def test_every_truncation_is_noticed(path: Path) -> None:
    save_checkpoint(path, SETTINGS, CONTENT)
    whole = path.read_bytes()
    for length in range(0, len(whole), 97):
        path.write_bytes(whole[:length])
        with pytest.raises(CheckpointError, match="not a readable checkpoint"):
            load_checkpoint(path, SETTINGS)


def test_other_settings_are_named_with_both_values(path: Path) -> None:
    save_checkpoint(path, SETTINGS, CONTENT)
    with pytest.raises(CheckpointError, match=r"other settings \(beta: 0.1 there, None now; seed: 3 there, 4 now\)"):
        load_checkpoint(path, {"seed": 4, **{k: v for k, v in SETTINGS.items() if k not in ("seed", "beta")}})


def test_another_version_is_an_error(path: Path) -> None:
    torch.save({"version": 99, "settings": SETTINGS}, path.parent.mkdir(parents=True) or path)
    with pytest.raises(CheckpointError, match="wanted checkpoint version 1, found 99"):
        load_checkpoint(path, SETTINGS)


def test_a_checkpoint_runs_no_code_of_others(path: Path) -> None:
    path.parent.mkdir(parents=True)
    torch.save({"version": 1, "settings": SETTINGS, "trap": os.system}, path)
    with pytest.raises(CheckpointError, match="not a readable checkpoint"):
        load_checkpoint(path, SETTINGS)


def test_plain_settings_pass_and_others_do_not() -> None:
    check_plain(SETTINGS)
    for bad in (Path("x"), np.float64(1.0), torch.ones(1), {1: object()}, [lambda: 0], {torch.ones(1): 1}):
        with pytest.raises(ConfigurationError, match=r"settings\['odd'\]: wanted a string, a number"):
            check_plain({"fine": 1, "odd": bad})
