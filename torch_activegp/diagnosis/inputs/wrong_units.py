"""Positions in degrees or millimetres, seen by the forces that such a motion would take."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray

from torch_activegp.data.local_polynomial import DEGREE, local_slope
from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run
from torch_activegp.errors import DataError

_WINDOW = 0.3
"""Accelerations are slopes of the velocity over so many seconds."""
_ROWS = 100
_LOUD = 10.0
"""Accelerations this far above what noise makes of them count."""
_BAD = 3.0
"""Forces that the model lacks, over those that it has, from which a unit is doubted."""
_GOOD = 1.0
"""The same in another unit, which then must be right."""
_MAYBE = 3.0
"""The same up to which a doubt is said: a load that swings takes little, and what is missing counts beside it."""
_BETTER = 10.0
_SURE = 100.0
"""Nobody takes a model for a machine that needs so many times its forces; the other unit is taken for certain."""
_SLIPS = {True: {"deg": 180 / np.pi}, False: {"mm": 1e3, "cm": 1e2}}
"""Units that positions of hinges and of slides are taken for SI in."""


@dataclasses.dataclass(frozen=True)
class Motion:
    """Rows of all runs: positions, velocities, accelerations ``(T, C)``, controls ``(T, nu)``, forces ``(T, nv)``.

    All are averaged as the accelerations are, or what is fast in them would seem to be lacking: 133 times the mean
    force of a loudspeaker's coil, for the pull of the spring on which its cone swings at 31 Hz.
    """

    position: Array
    velocity: Array
    acceleration: Array
    control: Array
    force: Array


def check_units(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run]) -> list[str]:
    """Refuses positions that need many times the forces that the model has, and would not in another unit.

    A motion in degrees that is read as radians is 57 times as large, and so is what it takes to accelerate it. What a
    model leaves out is seldom more than all that it has. Where the motion of some joints is prescribed, nothing is
    said: what holds them is no force of the model.

    Args:
        model: nominal.
        channels: the recorded joints.
        runs: for fitting.

    Returns:
        A doubt, in a sentence, where another unit would explain most of such forces, but not all.

    Raises:
        DataError: some joints seem to be recorded in another unit.
    """
    found = balance(model, channels, runs)
    if found is None:
        return []
    motion, missing, there = found.motion, found.missing, found.there
    before = float((missing / there).max())
    if before <= _BAD:
        return []
    tried: list[tuple[int, float, str, int]] = []
    for unit, slip, which in _guesses(channels):
        others, base = forces_of(model, channels, motion, np.where(which, 1.0 / slip, 1.0))
        after = float((others / base).max()) if (base > 0.0).all() else np.inf
        if after < _MAYBE and before > _BETTER * after:
            tried.append((int(which.sum()), after, unit, int(np.flatnonzero(which)[0])))
    if not tried:
        return []
    _, after, unit, first = min(tried)  # of the fewest columns
    joint, sure = channels.joints[first], after < _GOOD or before > _SURE
    less = "it would not" if after < _GOOD else f"{after:.1f}"
    message = (
        f"{_worst(model, channels, runs, first)}, column `qpos.{joint}`: rad or m wanted, but this motion would take "
        f"{before:.0f} times the forces that the model has; in {unit} {less}. "
        f"{'Name the unit' if sure else 'If so, name it'} in its line of a column map (--columns MAP.toml): "
        f'qpos.{joint} = {{ column = "...", unit = "{unit}" }}, in place of any unit there.'
    )
    if sure:
        raise DataError(message)
    return [message]


class Balance(NamedTuple):
    """A motion, and its forces as in :func:`lacking_forces`."""

    motion: Motion
    lacking: Array
    known: Array

    @property
    def missing(self) -> Array:
        """Root mean square of what is lacking, ``(C,)``."""
        return _rms(self.lacking)

    @property
    def there(self) -> Array:
        """The same of what the model has, ``(C,)``."""
        return _rms(self.known)


def balance(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run]) -> Balance | None:
    """What the forces of some runs' motion are.

    None where the motion of some joints is prescribed, where noise hides accelerations, and where a joint has no force.
    """
    motion = None if channels.prescribed is not None else motion_of(runs)
    if motion is None:
        return None
    found = Balance(motion, *lacking_forces(model, channels, motion, np.ones(len(channels.joints))))
    return None if (found.there <= 0.0).any() else found


def _rms(rows: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(rows), axis=0)))


def _worst(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run], c: int) -> str:
    """The run whose motion of a joint takes most beyond the forces that the model has."""
    beyond = np.zeros(len(runs))
    for number, run in enumerate(runs):
        motion = motion_of([run])
        if motion is not None:
            missing, there = forces_of(model, channels, motion, np.ones(len(channels.joints)))
            beyond[number] = (missing / np.maximum(there, 1e-300))[c]
    return runs[int(np.argmax(beyond))].label


def _guesses(channels: Channels) -> Iterator[tuple[str, float, NDArray[np.bool_]]]:
    """Units, their factors, and which joints have them: all of a kind, or one."""
    for hinge, slips in _SLIPS.items():
        kind = channels.hinge == hinge
        sets = [kind, *(np.arange(len(kind)) == c for c in np.flatnonzero(kind))] if kind.sum() > 1 else [kind]
        for unit, slip in slips.items():
            yield from ((unit, slip, which) for which in sets if which.any())


def motion_of(runs: Sequence[Run]) -> Motion | None:
    """Rows of all runs; None where noise hides the accelerations."""
    parts: list[list[Array]] = []
    seen, noise = [], []
    for run in runs:
        dt = float(np.median(run.dt))
        window = max(2 * round(0.5 * _WINDOW / dt) + 1, DEGREE + 2)
        if window >= len(run) // 2:
            continue
        rows = np.unique(np.linspace(window, len(run) - 1 - window, _ROWS).astype(int))
        where = 0.5 * (run.smooth[1:] + run.smooth[:-1])
        sums = (_summed(run, columns) for columns in (where, run.control, run.force))
        position, control, force = (_slopes(run.time, columns, window) for columns in sums)
        velocity, acceleration = (_slopes(run.time, columns, window) for columns in (run.smooth, run.velocity))
        parts.append([columns[rows] for columns in (position, velocity, acceleration, control, force)])
        seen.append((acceleration[rows] ** 2).mean(axis=0))
        noise.append(720.0 * run.noise**2 / (window**5 * dt**4))  # of a parabola fitted to the window
    if not parts or (np.mean(seen, axis=0) < _LOUD**2 * np.mean(noise, axis=0)).any():
        return None
    return Motion(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _summed(run: Run, columns: Array) -> Array:
    """The integral over time of what holds between rows ``(T - 1, n)``: ``(T, n)``."""
    return np.concatenate([0.0 * columns[:1], np.cumsum(columns * run.dt[:, None], axis=0)])


def _slopes(time: Array, columns: Array, window: int) -> Array:
    """The slope of each column ``(T, n)`` over so many rows."""
    clock, slopes = torch.from_numpy(time), np.zeros(columns.shape)
    for number in np.flatnonzero(columns.any(axis=0)):  # most joints have no known force
        slopes[:, number] = local_slope(clock, torch.from_numpy(columns[:, number].copy()), window).numpy()
    return slopes


def forces_of(model: mujoco.MjModel, channels: Channels, motion: Motion, factors: Array) -> tuple[Array, Array]:
    """What a motion takes beyond the model's forces, and its motors and weights, root mean squares ``(C,)``, N m or N.

    Args as of :func:`lacking_forces`.
    """
    missing, there = map(_rms, lacking_forces(model, channels, motion, factors))
    return missing, there


def lacking_forces(model: mujoco.MjModel, channels: Channels, motion: Motion, factors: Array) -> tuple[Array, Array]:
    """What a motion takes beyond the model's forces, and the size of its motors and weights, ``(T, C)``, N m or N.

    Args:
        model: nominal.
        channels: the recorded joints.
        motion: T rows.
        factors: what positions are multiplied by, ``(C,)``.
    """
    data = mujoco.MjData(model)
    missing, there = [], []
    product, acceleration = np.zeros(model.nv), np.zeros(model.nv)
    for row in range(len(motion.position)):
        data.qpos[:] = model.qpos0
        data.qpos[channels.qpos] = motion.position[row] * factors
        data.qvel[:] = 0.0
        data.ctrl[:] = motion.control[row]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        weight = data.qfrc_bias.copy()
        data.qvel[channels.dof] = motion.velocity[row] * factors
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fwdActuation(model, data)
        acceleration[channels.dof] = motion.acceleration[row] * factors
        mujoco.mj_mulM(model, data, product, acceleration)
        known = data.qfrc_actuator + motion.force[row]
        missing.append((product + data.qfrc_bias - data.qfrc_passive - known)[channels.dof])
        there.append((np.abs(known) + np.abs(weight))[channels.dof])
    return np.stack(missing), np.stack(there)
