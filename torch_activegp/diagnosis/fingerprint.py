"""One word for everything that a result depends on."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Sequence
from importlib.metadata import version
from typing import Any

import mujoco
import numpy as np

from torch_activegp.diagnosis.blackbox import BlackBox
from torch_activegp.diagnosis.machine import Machine
from torch_activegp.diagnosis.source import Source
from torch_activegp.physics.effect import Effect

_PACKAGES = ("torch-activegp", "mujoco", "numpy", "scipy", "torch", "gpytorch")


def fingerprint(source: Source, machine: Machine, effects: Sequence[Effect], *options: object) -> str:
    """A digest of model, recordings, effects, options and the versions of the packages that compute with them.

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
    _feed(digest, [*(version(name) for name in _PACKAGES), *without, *answers, list(effects), *options])
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
    else:
        digest.update(f"{type(value).__name__} {value!r};".encode())


def _plain(value: object) -> object:
    """What a value is made of."""
    if isinstance(value, mujoco.MjModel):
        buffer = np.zeros(mujoco.mj_sizeModel(value), dtype=np.uint8)
        mujoco.mj_saveModel(value, None, buffer)
        return buffer
    if isinstance(value, mujoco.MjSpec):
        return value.to_xml()
    if isinstance(value, Effect):
        kind = [value.name, value.target, value.variant, value.linear, _code(type(value))]
        return [*kind, value.seeds, *value.parameters]
    if dataclasses.is_dataclass(value):
        return [type(value).__name__, *(getattr(value, field.name) for field in dataclasses.fields(value))]
    return value


def _code(kind: type) -> str:
    """The source of a user's class; what it computes is not in its values. Ours go with the version."""
    if kind.__module__.startswith("torch_activegp."):
        return kind.__qualname__
    try:
        return inspect.getsource(kind)
    except (OSError, TypeError):  # typed in, and nowhere to be read
        return repr(id(kind))


def _answers(box: BlackBox, machine: Machine) -> list[object]:
    """The next states of a black box for all recorded states and controls."""
    out: list[object] = []
    for run in (*machine.fit, *machine.holdout):
        states = np.zeros((len(run) - 1, box.model.nq + box.model.nv))
        states[:, machine.channels.qpos] = run.smooth[:-1]
        states[:, box.model.nq + machine.channels.dof] = run.velocity[:-1]
        out.append(box.step(states, run.control))
    return out
