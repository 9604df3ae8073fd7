"""In which recorded poses bodies touch, or joints are at their limits; and whether constraints tie bodies together."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run

_POSES = 300
"""Rows of a run, evenly spread, that show how often something touches."""
TOUCHING = 0.01
"""Contact in fewer poses is an accident of noise or of shapes drawn too large."""
_WIDER = 0.005
"""Part of the machine's size, and of a joint's range, from which on it is about to touch."""


def touching(model: mujoco.MjModel, channels: Channels, run: Run, rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether something touches in some rows of a run."""
    data = mujoco.MjData(model)
    out = np.zeros(len(rows), dtype=bool)
    for i, row in enumerate(rows):
        data.qpos[:] = model.qpos0
        data.qpos[channels.qpos] = run.smooth[row]
        if channels.prescribed is not None and run.prescribed is not None:
            data.qpos[channels.prescribed.qpos] = run.prescribed.smooth[row]
        mujoco.mj_fwdPosition(model, data)
        out[i] = bool(data.ncon or data.nl)
    return out


def poses_that_touch(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run]) -> tuple[Array, NDArray[np.bool_]]:
    """Some recorded poses of runs, ``(N, C)``, and whether something touches in each, ``(N,)``."""
    poses, touches = [], []
    for run in runs:
        rows = np.arange(0, len(run), max(len(run) // _POSES, 1))
        poses.append(run.smooth[rows])
        touches.append(touching(model, channels, run, rows))
    return np.concatenate(poses), np.concatenate(touches)


def now_and_then(touches: NDArray[np.bool_]) -> bool:
    """Whether something touches in some poses, and not by accident: neither in hardly any nor in all, ``(N,)``."""
    return bool(TOUCHING < touches.mean() < 1.0)


def strikes(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run]) -> bool:
    """Whether a model touches something now and then in recorded runs."""
    return now_and_then(poses_that_touch(model, channels, runs)[1])


def is_tied(model: mujoco.MjModel) -> bool:
    """Whether equalities tie bodies of a model together, or tendons that do more than pass on what a drive pulls."""
    tendons = model.tendon_limited, model.tendon_frictionloss, model.tendon_armature
    forces = model.tendon_stiffness, model.tendon_stiffnesspoly, model.tendon_damping, model.tendon_dampingpoly
    return bool(model.neq or any(field.any() for field in (*tendons, *forces)))


def widened(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model with contacts and limits that are seen a little before they touch."""
    wide = copy.copy(model)
    wide.geom_margin += _WIDER * model.stat.extent
    wide.pair_margin += _WIDER * model.stat.extent
    wide.jnt_margin += _WIDER * np.ptp(model.jnt_range, axis=1)
    return wide
