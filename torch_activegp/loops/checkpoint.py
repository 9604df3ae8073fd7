"""Checkpoints that are whole or absent, and that refuse to continue another run."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import torch

from torch_activegp.errors import CheckpointError

_VERSION = 1


def save_checkpoint(path: Path, settings: dict[str, Any], content: dict[str, Any]) -> None:
    """Write a checkpoint under a temporary name, then rename it, so that a kill never leaves half a file.

    Args:
        path: where to write; its folder is made.
        settings: plain values that a resumed run must share.
        content: tensors, plain values and containers of them.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(path.name + ".part")
    with temporary.open("wb") as file:
        torch.save({"version": _VERSION, "settings": settings, **content}, file)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


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
        content = torch.load(path, weights_only=True)
        version, found = content["version"], content["settings"]
    except (pickle.UnpicklingError, RuntimeError, KeyError, EOFError, TypeError, OSError) as error:
        raise CheckpointError(f"{path} is not a readable checkpoint ({error}). Delete it and start again.") from error
    if version != _VERSION:
        raise CheckpointError(f"{path}: wanted checkpoint version {_VERSION}, found {version}. Start again.")
    changed = [key for key in {**settings, **found} if settings.get(key) != found.get(key)]
    if changed:
        details = "; ".join(f"{key}: {found.get(key)!r} there, {settings.get(key)!r} now" for key in sorted(changed))
        raise CheckpointError(
            f"{path} belongs to a run with other settings ({details}). Use its settings, or another output folder."
        )
    return content
