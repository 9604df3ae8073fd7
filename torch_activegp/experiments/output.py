"""Output folders that are never overwritten by accident, and files that are whole or absent."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import pandas as pd

from torch_activegp.errors import CheckpointError, ConfigurationError
from torch_activegp.files import written_whole

_SETTINGS = "settings.json"


def open_output(
    folder: Path, settings: Mapping[str, Any], *, resume: bool, may_grow: Sequence[str] = ("episodes",)
) -> Path:
    """Make an output folder, or go back to one that holds a run with the same settings.

    A run can be resumed with more of something, e.g. more episodes. To resume where nothing is yet starts a new run.

    Args:
        folder: where to write.
        settings: plain values that identify the run; kept in ``settings.json``.
        resume: continue the run that is there.
        may_grow: the settings that a resumed run may increase, or extend if they are lists.

    Returns:
        The folder.

    Raises:
        ConfigurationError: the folder is not empty and ``resume`` is False, it is a file, or it cannot be written.
        CheckpointError: the folder holds a run with other settings, or none of ours.
    """
    check_output(folder, settings, resume=resume, may_grow=may_grow)
    with _writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / _SETTINGS, settings)
    return folder


def check_output(
    folder: Path, settings: Mapping[str, Any], *, resume: bool, may_grow: Sequence[str] = ("episodes",)
) -> None:
    """Raise what :func:`open_output` would, as far as can be known without writing."""
    with _writing(folder):
        if folder.exists() and not folder.is_dir():
            raise ConfigurationError(f"Wanted a folder for the output, found the file {folder}. Choose another --out.")
        if not folder.is_dir():
            _require_parent(folder)
        if not folder.is_dir() or not any(folder.iterdir()):
            return
        if not resume:
            raise ConfigurationError(
                f"The output folder {folder} is not empty. Choose another --out, or pass --resume to continue a run "
                "there."
            )
        if not (folder / _SETTINGS).is_file():
            raise CheckpointError(
                f"{folder} is not empty and holds no {_SETTINGS}, so no run to resume. Choose another --out."
            )
        _compare(folder / _SETTINGS, settings, may_grow)


def _require_parent(folder: Path) -> None:
    parent = next(path for path in folder.absolute().parents if path.exists())
    if not parent.is_dir() or not os.access(parent, os.W_OK | os.X_OK):
        what = "cannot be written" if parent.is_dir() else "is a file"
        raise ConfigurationError(f"Cannot make the output folder {folder}: {parent} {what}. Choose another --out.")
    try:  # rights alone do not tell: some file systems hold no folders of ours
        tempfile.TemporaryDirectory(dir=parent).cleanup()
    except OSError as error:
        raise ConfigurationError(
            f"Cannot make the output folder {folder}: {error.strerror or error} in {parent}. Choose another --out."
        ) from error


def _compare(path: Path, settings: Mapping[str, Any], may_grow: Sequence[str]) -> None:
    try:
        found = dict(json.loads(path.read_text(encoding="utf-8")))
    except (TypeError, ValueError) as error:
        raise CheckpointError(f"{path} is damaged ({error}). Choose another --out.") from error
    wanted = json.loads(json.dumps(settings))
    changed = [
        key
        for key in sorted({**wanted, **found})
        if found.get(key) != wanted.get(key) and not (key in may_grow and _grows(found.get(key), wanted.get(key)))
    ]
    if changed:
        details = "; ".join(f"{key}: {found.get(key)!r} there, {wanted.get(key)!r} now" for key in changed)
        raise CheckpointError(
            f"{path.parent} holds a run with other settings ({details}). Use its settings (only "
            f"{', '.join(may_grow)} may grow), or choose another --out."
        )


def _grows(before: object, now: object) -> bool:
    if isinstance(before, list) and isinstance(now, list):
        return all(item in now for item in before)
    return isinstance(before, int) and isinstance(now, int) and now >= before


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ConfigurationError(
            f"Cannot write to {path}: {error.strerror or error}. Choose another --out, or mend its permissions or the "
            "disk."
        ) from error


@contextmanager
def atomic(path: Path) -> Iterator[BinaryIO]:
    """A file to write to; it becomes ``path`` if that succeeds, and is removed otherwise.

    Raises:
        ConfigurationError: the disk or the folder cannot be written.
    """
    with _writing(path), written_whole(path) as file:
        yield file


def write_text(path: Path, text: str) -> None:
    """Write a whole text file, UTF-8 with Unix line ends, or none."""
    with atomic(path) as file:
        file.write(text.encode())


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a table as CSV; floats so that reading gives the same bits."""
    write_text(path, table.to_csv(index=False, lineterminator="\n"))


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write plain values as JSON."""
    write_text(path, json.dumps(value, indent=2) + "\n")
