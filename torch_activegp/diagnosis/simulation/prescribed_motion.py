"""Joints that something else moved: their motion comes from the recording and drives the rest of the machine."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.simulation.hermite import position_between, velocity_between
from torch_activegp.physics.effect import Step

_HEAVY = 1e7
RUNGE_KUTTA = int(mujoco.mjtIntegrator.mjINT_RK4)
_IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICIT)
_DIRECT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


def make_heavy(model: mujoco.MjModel, joints: Channels) -> None:
    """Gives joints rotors that no force of the machine moves, and takes away what acts on them alone; in place.

    A rotor stands in the joint's own equation alone: the other joints feel how it accelerates, not how heavy it is.
    """
    dof, ids, before = joints.dof, model.dof_jntid[joints.dof], float(model.dof_M0.sum())
    model.dof_armature[dof] += _HEAVY * model.dof_M0[dof]
    for own in ("dof_frictionloss", "dof_damping", "dof_dampingpoly"):
        getattr(model, own)[dof] = 0.0
    for own in ("jnt_limited", "jnt_stiffness", "jnt_stiffnesspoly"):
        getattr(model, own)[ids] = 0
    model.actuator_gear[only_on(model, joints)] = 0.0
    mujoco.mj_setConst(model, mujoco.MjData(model))
    model.opt.tolerance *= before / model.dof_M0.sum()  # MuJoCo's solver stops at a part of the mean inertia


def only_on(model: mujoco.MjModel, joints: Channels) -> NDArray[np.bool_]:
    """Which actuators act on one of some joints and on nothing else, ``(nactuator,)``."""
    direct = np.isin(model.actuator_trntype, _DIRECT)
    return np.asarray(direct & np.isin(model.actuator_trnid[:, 0], model.dof_jntid[joints.dof]))


class PrescribedMotion:
    """Puts the joints of :func:`make_heavy` where they were before every time step, and pushes them to the next place.

    The push is such that the integrator itself would take them there, so that it moves the joints that they carry along
    by just as much: in semi-implicit steps it leads from one mean velocity to the next; in those of Runge-Kutta, whose
    mean velocity is that of both ends, to velocities without the error of second order that this mean has. An implicit
    step takes the velocities at its end for forces that depend on them, and finds there those of its beginning.

    Args:
        model: with the heavy joints.
        joints: the P joints.
        segments: S segments.
        lengths: of the T time steps of every segment, ``(S, T)``, s.
        rest: where the joints stay in runs that prescribe no motion, ``(S, P)``.
    """

    def __init__(
        self, model: mujoco.MjModel, joints: Channels, segments: Segments, lengths: Array, rest: Array
    ) -> None:
        self._joints, self._step = joints, 0
        start = np.array([segments.runs[r].time[f] for r, f in zip(segments.run, segments.first, strict=True)])
        more = np.concatenate([-lengths[:, :1], lengths[:, :1], lengths, lengths[:, -1:]], axis=1)
        time = start[:, None] + np.cumsum(more, axis=1)
        position, speed = np.repeat(rest[:, None], time.shape[1], axis=1), np.zeros((*time.shape, rest.shape[1]))
        for number, run in enumerate(segments.runs):
            own = segments.run == number
            if run.prescribed is not None and own.any():
                position[own], speed[own] = _along(run.prescribed, time[own])
        if model.opt.integrator == RUNGE_KUTTA:
            leading = speed[:, 1:-1] - np.diff(speed, 2, axis=1) / 12.0
            speed[:, 2:-1] = leading[:, 1:]
        else:
            leading = (np.diff(position, axis=1) / np.diff(time)[..., None])[:, :-1]
        leading[:, 0] = speed[:, 1]
        if model.opt.integrator == _IMPLICIT:
            speed[:, 1:-2] -= np.diff(leading, axis=1)
        push = model.dof_M0[joints.dof] * np.diff(leading, axis=1) / lengths[..., None]
        self._position, self._velocity, self._push = position[:, 1:-1], speed[:, 1:-1], push

    def __call__(self, step: Step) -> None:
        """Sets position, velocity and force for the next time step of N x S simulations."""
        k, count = self._step, len(step.qpos) // len(self._position)
        self._step += 1
        step.qpos[:, self._joints.qpos] = np.tile(self._position[:, k], (count, 1))
        step.qvel[:, self._joints.dof] = np.tile(self._velocity[:, k], (count, 1))
        step.force[:, self._joints.dof] = np.tile(self._push[:, k], (count, 1))


def _along(run: Run, time: Array) -> tuple[Array, Array]:
    """Positions and velocities ``(n, T, P)`` at times ``(n, T)``, s: cubic between rows, straight on after the last."""
    clock, value, slope = (column[run.counted] for column in (run.time, run.smooth, run.velocity))
    row = np.clip(np.searchsorted(clock, time, side="right") - 1, 0, len(clock) - 2)
    late = np.maximum(time - clock[-1], 0.0)[..., None]
    h = np.diff(clock)[row][..., None]
    x = (np.minimum(time, clock[-1]) - clock[row])[..., None] / h
    ends = value[row], value[row + 1], slope[row], slope[row + 1]
    position, speed = position_between(x, h, *ends), velocity_between(x, h, *ends)
    return position + late * speed, speed
