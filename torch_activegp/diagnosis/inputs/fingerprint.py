"""One word for everything that a result depends on."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import secrets
import sys
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.source import Source
from torch_activegp.physics.effect import Effect

_PACKAGES = ("mujoco", "numpy", "scipy", "torch", "gpytorch")
_OURS = next(folder for folder in Path(__file__).resolve().parents if folder.name == __name__.partition(".")[0])
"""The package's own folder: what computes lies in all of it."""


def fingerprint(source: Source, machine: Machine, effects: Sequence[Effect], *options: object) -> str:
    """A digest of model, recordings, effects, options, this package's code and the versions of what it computes with.

    A black box is known by what it returns for the recorded states and controls.

    Args:
        source: the nominal model.
        machine: with recordings laid over it.
        effects: what is tried.
        options: numbers, words, paths.
    """
    digest = hashlib.sha256()
    answers = [] if source.box is None else [source.box.name, source.box.simulator.dt, *_answers(source.box, machine)]
    without = [dataclasses.replace(source, box=None), dataclasses.replace(machine, box=None)]
    versions = [_code_of(_OURS), tuple(sys.version_info), *(version(name) for name in _PACKAGES)]
    _feed(digest, [*versions, *without, *answers, list(effects), *options])
    return digest.hexdigest()


def _feed(digest: Any, value: object) -> None:
    """Takes in a value, so that two sequences of values that differ anywhere are not the same bytes."""
    value = _plain(value)
    if isinstance(value, np.ndarray):
        digest.update(f"{value.dtype} {value.shape};".encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, list | tuple):
        digest.update(f"{len(value)}:".encode())
        for item in value:
            _feed(digest, item)
    elif value is None or isinstance(value, bool | int | float | str | Path):
        digest.update(f"{type(value).__name__} {value!r};".encode())
    else:
        raise TypeError(f"A value of a known kind wanted, found a {type(value).__qualname__}: {value!r}.")


def _plain(value: object) -> object:
    """What a value is made of."""
    if isinstance(value, mujoco.MjModel):
        buffer = np.zeros(mujoco.mj_sizeModel(value), dtype=np.uint8)
        mujoco.mj_saveModel(value, None, buffer)
        return buffer
    if isinstance(value, mujoco.MjSpec):
        return value.to_xml()
    if isinstance(value, Effect):
        return [value.name, *_sources(type(value)), *_fields(value)]
    if dataclasses.is_dataclass(value):
        return [type(value).__name__, *_fields(value)]
    if isinstance(value, dict):
        return ["dict", *([key, item] for key, item in value.items())]
    if isinstance(value, set | frozenset):
        return ["set", *sorted(_word(item) for item in value)]
    return value.item() if isinstance(value, np.generic) else value


def _fields(value: Any) -> list[object]:
    return [getattr(value, field.name) for field in dataclasses.fields(value)]


def _word(value: object) -> str:
    digest = hashlib.sha256()
    _feed(digest, value)
    return digest.hexdigest()


def _sources(kind: type) -> list[str]:
    """The files of a user's class and of all above it; what they compute is not in its values. Ours are known."""
    return [kind.__qualname__, *(_source(base) for base in kind.__mro__ if not _is_known(base))]


def _is_known(kind: type) -> bool:
    return kind is object or kind.__module__.startswith("torch_activegp.")


def _source(kind: type) -> str:
    try:
        inspect.getsource(kind)
        return hashlib.sha256(Path(inspect.getfile(kind)).read_bytes()).hexdigest()
    except (OSError, TypeError):  # typed in, and nowhere to be read
        return secrets.token_hex()


@cache
def _code_of(folder: Path) -> str:
    """A digest of a package's code."""
    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.py")):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(folder)} {len(content)};".encode() + content)
    return digest.hexdigest()


def _answers(box: BlackBox, machine: Machine) -> list[object]:
    """The next states of a black box for all recorded states and controls."""
    out: list[object] = []
    for run in (*machine.fit, *machine.holdout):
        states = np.zeros((len(run) - 1, box.model.nq + box.model.nv))
        states[:, machine.channels.qpos] = run.smooth[:-1]
        states[:, box.model.nq + machine.channels.dof] = run.velocity[:-1]
        out.append(box.step(states, run.control))
    return out
