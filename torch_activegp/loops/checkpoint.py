"""Checkpoints that are whole or absent, and that refuse to continue another run."""

from __future__ import annotations

import pickle
import zipfile
from pathlib import Path
from typing import Any

import torch

from torch_activegp.errors import CheckpointError, ConfigurationError
from torch_activegp.files import written_whole

_VERSION = 1
_DAMAGE = (pickle.UnpicklingError, zipfile.BadZipFile, RuntimeError, LookupError, EOFError, TypeError, ValueError)


def save_checkpoint(path: Path, settings: dict[str, Any], content: dict[str, Any]) -> None:
    """Write a checkpoint under a temporary name, read it back, then rename it.

    A kill never leaves half a file, and a failure leaves the earlier file as it was.

    Args:
        path: where to write; its folder is made.
        settings: plain values that a resumed run must share.
        content: tensors, plain values and containers of them.

    Raises:
        CheckpointError: the file cannot be written, or holds other objects, which cannot be read again.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as file:
            torch.save({"version": _VERSION, "settings": settings, **content}, file)
            file.seek(0)
            torch.load(file, weights_only=True)
    except (OSError, RuntimeError, pickle.PickleError, AttributeError, TypeError) as error:
        raise CheckpointError(
            f"The checkpoint {path} could not be written ({_first_line(error)}); an earlier one is as it was. Make "
            "room or choose another place; where an object cannot be saved, let its state_dict hold tensors and plain "
            "values only."
        ) from error


def load_checkpoint(path: Path, settings: dict[str, Any]) -> dict[str, Any]:
    """Read a checkpoint of a run with the same settings.

    Args:
        path: where it was written.
        settings: the present run's.

    Returns:
        The content.

    Raises:
        CheckpointError: the file is missing, damaged, or belongs to other settings.
    """
    if not path.is_file():
        raise CheckpointError(f"Wanted a checkpoint at {path}, found none. Start without resuming.")
    try:
        content = _read(path)
        version, found = content["version"], dict(content["settings"])
    except _DAMAGE as error:
        raise CheckpointError(
            f"{path} is not a readable checkpoint ({_first_line(error)}). Delete it and start again."
        ) from error
    if version != _VERSION:
        raise CheckpointError(f"{path}: wanted checkpoint version {_VERSION}, found {version}. Start again.")
    changed = [key for key in {**settings, **found} if settings.get(key) != found.get(key)]
    if changed:
        details = "; ".join(f"{key}: {found.get(key)!r} there, {settings.get(key)!r} now" for key in sorted(changed))
        raise CheckpointError(
            f"{path} belongs to a run with other settings ({details}). Use its settings, or another output folder."
        )
    return content


def check_plain(settings: dict[str, Any]) -> None:
    """Check that settings can be written to a checkpoint and compared with those of another run.

    Raises:
        ConfigurationError: a value is not a string, a number, None, or a list, tuple or dict of such.
    """
    for key, value in settings.items():
        if not _is_plain(value):
            raise ConfigurationError(
                f"settings[{key!r}]: wanted a string, a number, None, or a list, tuple or dict of such, found "
                f"{type(value).__name__} {value!r}. Convert it, e.g. with str() or float()."
            )


def _is_plain(value: object) -> bool:
    if isinstance(value, dict):
        return all(_is_plain(part) for pair in value.items() for part in pair)
    if isinstance(value, list | tuple):
        return all(map(_is_plain, value))
    return value is None or type(value) in (str, int, float, bool)


def _read(path: Path) -> dict[str, Any]:
    with zipfile.ZipFile(path) as archive:  # compares check sums, which torch.load does not
        broken = archive.testzip()
    if broken is not None:
        raise zipfile.BadZipFile(f"check sum of {broken} is wrong")
    return torch.load(path, weights_only=True)


def _first_line(error: Exception) -> str:
    return str(error).partition("\n")[0] or type(error).__name__
