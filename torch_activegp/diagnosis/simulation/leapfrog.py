"""Damping in the leapfrog scheme: by the trapezoidal rule, so that it is of second order too."""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.simulators.mujoco_warnings import warnings_to

_logger = logging.getLogger(__name__)
_MOST = 0.5
"""Of the least inertia of all joints together: the mass matrix of the nominal stays positive in its first pose."""
_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)
_POSES = 3
_LITTLE = 1e-6
"""Of the inertia at a joint: the force on it at some rad/s or m/s that counts for none."""


def halve_damping(model: mujoco.MjModel, field: Callable[[str], Array], rows: int, step: Array) -> None:
    """Lets the damping of some simulations act with the mean of the velocities before and after each time step.

    Implicit integration takes the velocity after it, M dv = h (f - D (v + dv)), which is of first order. The mean is
    (M + h D / 2) dv = h (f - D v): the same with the inertia less h D / 2.

    Args:
        model: of all simulations, integrated with ``implicitfast``.
        field: gives a field of the model with one value for each simulation; dampings are set.
        rows: the first so many simulations.
        step: length h of the time steps of each, ``(rows,)``, s.
    """
    damping = field("dof_damping")[:rows] + servo_damping(model)
    if not damping.any():
        return
    inertia = np.minimum(0.5 * step[:, None] * damping, _MOST / model.nv / model.dof_invweight0)
    field("dof_armature")[:rows] -= inertia
    field("dof_M0")[:rows] -= inertia


def servo_damping(model: mujoco.MjModel) -> Array:
    """What drives of joints add to the damping by their own law, ``(nv,)``, N m s/rad or N s/m.

    MuJoCo takes none of those implicitly whose force is at its limit; drives with a limit are left out.
    """
    out = np.zeros(model.nv)
    for drive in np.flatnonzero((model.actuator_trntype == _JOINT) & (model.actuator_biastype == _AFFINE)):
        joint = model.actuator_trnid[drive, 0]
        if not (model.actuator_forcelimited[drive] or model.jnt_actfrclimited[joint]):
            out[model.jnt_dofadr[joint]] -= model.actuator_biasprm[drive, 2] * model.actuator_gear[drive, 0] ** 2
    return np.maximum(out, 0.0)


def is_of_second_order(model: mujoco.MjModel) -> bool:
    """Whether the leapfrog scheme is, for a model: its forces depend on velocities by linear damping alone.

    Coriolis forces, drag and the damping of limited servos act half a time step early or late in it; and any servo may
    turn out to be limited.
    """
    if servo_damping(model).any():
        return False
    model = copy.copy(model)
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    data, rng, damping = mujoco.MjData(model), np.random.default_rng(0), model.dof_damping
    with warnings_to(_logger.debug):
        for _ in range(_POSES):
            mujoco.mj_resetData(model, data)
            mujoco.mj_integratePos(model, data.qpos, rng.normal(size=model.nv), 1.0)
            forces, speed = [], rng.normal(size=model.nv)
            for data.qvel[:] in (np.zeros(model.nv), speed):
                mujoco.mj_fwdPosition(model, data)
                mujoco.mj_fwdVelocity(model, data)
                mujoco.mj_fwdActuation(model, data)
                forces.append(data.qfrc_passive - data.qfrc_bias + data.qfrc_actuator)
            other = forces[1] - forces[0] + damping * speed
            if (np.abs(other) > _LITTLE * (model.dof_M0 + damping)).any():
                return False
    return True
