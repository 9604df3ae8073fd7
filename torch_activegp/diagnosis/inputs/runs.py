"""Recordings laid over a model: which joint is which coordinate, on a clock that a simulation can follow."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import mujoco
import numpy as np
import torch
from numpy.typing import NDArray

from torch_activegp.data import Recording, noise_std, unwrap_angles
from torch_activegp.diagnosis.inputs.control_limits import control_limits
from torch_activegp.diagnosis.inputs.coupling import coupling
from torch_activegp.diagnosis.inputs.glitches import bridged, glitches, in_words
from torch_activegp.diagnosis.inputs.smoothing import follow, smooth
from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.errors import DataError
from torch_activegp.physics.naming import actuator_name, joint_name

Array = NDArray[np.float64]
Smoother = Callable[[Array, Array, float], tuple[Array, Array]]
_SCALAR = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
MISSING = 1.5
"""Median steps from which on rows are missing in a step."""
MIN_ROWS = 12
_SLOWEST = 0.9
"""Longest time between rows, s: at 1 kHz in ms it is 1. No machine in motion is recorded as slowly."""


@dataclasses.dataclass(frozen=True)
class Channels:
    """The recorded joints of a model.

    Args:
        joints: names, C of them.
        qpos: addresses of their positions, ``(C,)``.
        dof: addresses of their velocities, ``(C,)``.
        hinge: whether each is a hinge, ``(C,)``.
        prescribed: the joints whose motion is an input and is not explained; None where there are none.
    """

    joints: tuple[str, ...]
    qpos: NDArray[np.int64]
    dof: NDArray[np.int64]
    hinge: NDArray[np.bool_]
    prescribed: Channels | None = None

    @classmethod
    def of(cls, model: mujoco.MjModel, recordings: Sequence[Recording]) -> Channels:
        """Finds the joints that every recording holds.

        Raises:
            DataError: a recorded joint or actuator is not in the model, no joint is in all recordings, or they do not
                prescribe the same joints, or prescribe all.
        """
        names = {joint_name(model, i): i for i in range(model.njnt)}
        for recording in recordings:
            _check_columns(recording, model, names)
        prescribed = _prescribed(recordings)
        common = [name for name in names if all(f"qpos.{name}" in recording for recording in recordings)]
        if not common:
            raise DataError("no joint has a position in all recordings. Give recordings of the same joints.")
        free = [name for name in common if name not in prescribed]
        if not free:
            raise DataError(
                f"{recordings[0].label}: a recorded joint to explain wanted, found that all of them are prescribed "
                f"({', '.join(common)}). Leave `prescribed` out of the column map for those that the machine moved."
            )
        given = cls._at(model, [names[name] for name in names if name in prescribed]) if prescribed else None
        return dataclasses.replace(cls._at(model, [names[name] for name in free]), prescribed=given)

    @classmethod
    def _at(cls, model: mujoco.MjModel, ids: list[int]) -> Channels:
        return cls(
            tuple(joint_name(model, i) for i in ids),
            model.jnt_qposadr[ids].astype(np.int64),
            model.jnt_dofadr[ids].astype(np.int64),
            model.jnt_type[ids] == int(mujoco.mjtJoint.mjJNT_HINGE),
        )

    @property
    def units(self) -> list[str]:
        """``rad`` or ``m`` for each."""
        return ["rad" if hinge else "m" for hinge in self.hinge]


@dataclasses.dataclass(frozen=True)
class Run:
    """One recording on the clock of the simulation: K intervals between K + 1 rows.

    Args:
        label: name for people.
        time: ``(K + 1,)``, s.
        position: recorded positions ``(K + 1, C)``; interpolated where no row was recorded.
        recorded: whether a row was recorded, ``(K + 1,)``.
        velocity: slopes of local polynomials, ``(K + 1, C)``, rad/s or m/s.
        smooth: positions freed of noise along these slopes, ``(K + 1, C)``.
        control: held from each row to the next, within the actuators' limits, ``(K, nu)``.
        force: known external generalised force, ``(K, nv)``.
        noise: white-noise floor of each channel from differences, ``(C,)``.
        prescribed: the same of the P prescribed joints; None where they stay where a simulation starts.
        coupling: how far a displacement of one of them moves each channel, ``(C, P)``.
        video: whether the errors of the positions last, as those of a video do.
        left_out: which recorded rows count for nothing: glitches, what a filter made; ``(K + 1,)``; None where none.
        notes: which of its rows were left out, in words.
        filters: what each channel is behind, ``(C,)``; None where that was not looked for.
        unsure: by how much controls may be off that were guessed in missing rows, ``(K, nu)``; None where none was.
    """

    label: str
    time: Array
    position: Array
    recorded: NDArray[np.bool_]
    velocity: Array
    smooth: Array
    control: Array
    force: Array
    noise: Array
    prescribed: Run | None = None
    coupling: Array | None = None
    video: bool = False
    left_out: NDArray[np.bool_] | None = None
    notes: tuple[str, ...] = ()
    filters: tuple[SteepFilter | None, ...] | None = None
    unsure: Array | None = None

    @property
    def dt(self) -> Array:
        """Length of each interval ``(K,)``, s."""
        return np.diff(self.time)

    @property
    def counted(self) -> NDArray[np.bool_]:
        """The rows that say where the machine was, ``(K + 1,)``: recorded, and not left out."""
        return self.recorded if self.left_out is None else self.recorded & ~self.left_out

    def __len__(self) -> int:
        return len(self.time)


def make_run(recording: Recording, model: mujoco.MjModel, channels: Channels, clock: float | None = None) -> Run:
    """Lays a recording over a model.

    The motion of prescribed joints is followed more closely than that of the others, which only guides first guesses. A
    dropped row (a step of more than 1.5 median steps) is filled with rows that hold the control and count for
    nothing; so do rows in which a position is a glitch, and rows between those of a recording that is slower than the
    clock.

    Args:
        recording: the run.
        model: that it is laid over.
        channels: the joints that all recordings hold.
        clock: time between the rows of the fastest recording, s: all runs are simulated in the same time steps, some in
            an interval. None for the recording's own.

    Raises:
        DataError: too short, or an external force on a joint that the model does not have.
    """
    run = _laid(recording, model, channels, smooth, clock)
    if channels.prescribed is None:
        return run
    given = _laid(recording, model, channels.prescribed, follow, clock)
    poses = np.tile(model.qpos0, (len(run), 1))
    poses[:, channels.qpos], poses[:, channels.prescribed.qpos] = run.smooth, given.smooth
    carried = coupling(model, poses, channels.dof, channels.prescribed.dof)
    notes = (*run.notes, *given.notes)
    return dataclasses.replace(run, prescribed=given, coupling=carried, notes=notes)


def _laid(
    recording: Recording, model: mujoco.MjModel, channels: Channels, smoother: Smoother, clock: float | None
) -> Run:
    if len(recording) < MIN_ROWS:
        raise DataError(f"{recording.label}: too short, {len(recording)} rows found, {MIN_ROWS} wanted. Record longer.")
    step = float(np.median(np.diff(recording.time.numpy())))
    if step > _SLOWEST:
        raise DataError(
            f"{recording.label}, column `time`: seconds wanted, found a row every {step:.4g}; no motion of a machine "
            "is followed like that. If the clock counts ms or us, say so in a column map (--columns MAP.toml, "
            '`time = { unit = "ms" }`); else record faster.'
        )
    columns = [f"qpos.{joint}" for joint in channels.joints]
    turning = [joint for joint, hinge in zip(channels.joints, channels.hinge, strict=True) if hinge]
    recording = unwrap_angles(recording, turning) if turning else recording
    time = recording.time.numpy()
    position = np.stack([recording[column].numpy() for column in columns], axis=1)
    inputs = input_addresses(model)
    control = np.zeros((len(time), model.nu))
    for name in recording.actuators:
        control[:, inputs[name]] = recording[f"ctrl.{name}"].numpy()
    control = np.clip(control, *control_limits(model))
    force = np.zeros((len(time), model.nv))
    for column in recording.columns:
        if column.startswith("qfrc."):
            force[:, _dof(model, recording.label, column)] = recording[column].numpy()
    noise = np.array([noise_std(torch.from_numpy(signal.copy()), recording.time) for signal in position.T])
    found = glitches(time, position, noise)
    position = bridged(time, position, found.lost)
    slopes, values = zip(
        *(smoother(time, signal, sigma) for signal, sigma in zip(position.T, noise, strict=True)), strict=True
    )
    index, filled = _filled(time, clock)
    glitch = np.zeros_like(index)
    glitch[index] = found.lost.any(axis=1)
    held = np.minimum(np.searchsorted(time, filled + 1e-12, side="right") - 1, len(time) - 1)
    return Run(
        label=recording.label,
        time=filled - filled[0],
        position=_interpolate(filled, time, position),
        recorded=index,
        velocity=_interpolate(filled, time, np.stack(slopes, axis=1)),
        smooth=_interpolate(filled, time, np.stack(values, axis=1)),
        control=control[held[:-1]],
        force=force[held[:-1]],
        noise=noise,
        video=recording.video,
        left_out=glitch if glitch.any() else None,
        notes=in_words(time, found, channels.joints),
    )


def median_step(runs: Sequence[Run]) -> float:
    """The time between rows, s."""
    return float(np.median(np.concatenate([run.dt for run in runs])))


def input_addresses(model: mujoco.MjModel) -> dict[str, int]:
    """The first control of every actuator that has one."""
    fed = np.flatnonzero(model.actuator_ctrlnum > 0)
    return {actuator_name(model, i): int(model.actuator_ctrladr[i]) for i in fed}


def _dof(model: mujoco.MjModel, label: str, column: str) -> int:
    """The degree of freedom that a column of external forces acts on."""
    names = [joint_name(model, i) for i in range(model.njnt)]
    name = column.partition(".")[2]
    if name not in names or int(model.jnt_type[names.index(name)]) not in _SCALAR:
        raise DataError(
            f"{label}, column `{column}`: a hinge or a slide of the model wanted; its joints are "
            f"{', '.join(names) or 'none'}. Rename the column, or map it (--columns MAP.toml)."
        )
    return int(model.jnt_dofadr[names.index(name)])


def _check_columns(recording: Recording, model: mujoco.MjModel, names: Mapping[str, int]) -> None:
    """Refuses joints and actuators that the model does not have, or not as a hinge or a slide."""
    for joint in recording.joints:
        if joint not in names:
            raise DataError(
                f"{recording.label}, column `qpos.{joint}`: the model has no joint `{joint}`; its joints are "
                f"{', '.join(names) or 'none'}. Rename the column, or map it (--columns MAP.toml)."
            )
        if int(model.jnt_type[names[joint]]) not in _SCALAR:
            raise DataError(
                f"{recording.label}, column `qpos.{joint}`: a hinge or a slide wanted, found a free or ball "
                "joint. Model it as hinges and slides, one column each."
            )
    actuators = input_addresses(model)
    for actuator in recording.actuators:
        if actuator not in actuators:
            raise DataError(
                f"{recording.label}, column `ctrl.{actuator}`: the model has no actuator `{actuator}`; its "
                f"actuators are {', '.join(sorted(actuators)) or 'none'}. Rename the column, or map it "
                "(--columns MAP.toml)."
            )


def _prescribed(recordings: Sequence[Recording]) -> set[str]:
    """The joints whose motion all recordings prescribe."""
    first = recordings[0]
    for other in recordings:
        if set(other.prescribed) != set(first.prescribed):
            found = [f"{', '.join(run.prescribed) or 'none'} in {run.label}" for run in (first, other)]
            raise DataError(
                f"{other.label}: the same prescribed joints in all recordings wanted, found {' and '.join(found)}. "
                "Diagnose them apart."
            )
    return set(first.prescribed)


def _filled(time: Array, clock: float | None) -> tuple[NDArray[np.bool_], Array]:
    steps = np.diff(time)
    own = float(np.median(steps))
    step = own if clock is None or own <= MISSING * clock else clock
    count = np.maximum(np.rint(steps / step), 1).astype(int)
    count[steps <= MISSING * step] = 1
    rows, recorded = [time[:1]], [True]
    for start, length, n in zip(time[:-1], steps, count, strict=True):
        rows.append(start + length * np.arange(1, n + 1) / n)
        recorded += [False] * (n - 1) + [True]
    return np.array(recorded), np.concatenate(rows)


def _interpolate(clock: Array, time: Array, values: Array) -> Array:
    return np.stack([np.interp(clock, time, column) for column in values.T], axis=1)
