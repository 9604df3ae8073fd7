"""Output folders that are never overwritten by accident, and files that are whole or absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pandas as pd

from torch_activegp.errors import CheckpointError, ConfigurationError

_SETTINGS = "settings.json"


def open_output(folder: Path, settings: dict[str, Any], *, resume: bool) -> Path:
    """Make an output folder, or go back to one that holds a run with the same settings.

    Args:
        folder: where to write.
        settings: plain values that identify the run; kept in ``settings.json``.
        resume: continue the run that is there.

    Returns:
        The folder.

    Raises:
        ConfigurationError: the folder is not empty and ``resume`` is False, or it is a file.
        CheckpointError: there is nothing to resume, or it has other settings.
    """
    if folder.exists() and not folder.is_dir():
        raise ConfigurationError(f"Wanted a folder for the output, found the file {folder}. Choose another --out.")
    path = folder / _SETTINGS
    if resume and path.is_file():
        _compare(path, settings)
        return folder
    if folder.is_dir() and any(folder.iterdir()):
        if resume:
            raise CheckpointError(f"{folder} is not empty and holds no {_SETTINGS}: it is no run of ours to resume.")
        raise ConfigurationError(
            f"The output folder {folder} is not empty. Choose another --out, or pass --resume to continue a run there."
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_text(path, json.dumps(settings, indent=2) + "\n")
    return folder


def _compare(path: Path, settings: dict[str, Any]) -> None:
    try:
        found = json.loads(path.read_text())
    except json.JSONDecodeError as error:
        raise CheckpointError(f"{path} is damaged ({error}). Choose another --out.") from error
    wanted = json.loads(json.dumps(settings))
    changed = sorted(key for key in {**wanted, **found} if wanted.get(key) != found.get(key))
    if changed:
        details = "; ".join(f"{key}: {found.get(key)!r} there, {wanted.get(key)!r} now" for key in changed)
        raise CheckpointError(f"{path.parent} holds a run with other settings ({details}). Choose another --out.")


def write_text(path: Path, text: str) -> None:
    """Write under a temporary name, then rename."""
    temporary = path.with_name(path.name + ".part")
    temporary.write_text(text)
    temporary.replace(path)


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a table as CSV with full precision."""
    write_text(path, table.to_csv(index=False))


def write_json(path: Path, value: dict[str, Any]) -> None:
    """Write plain values as JSON."""
    write_text(path, json.dumps(value, indent=2) + "\n")
