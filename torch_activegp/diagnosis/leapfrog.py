"""Damping in the leapfrog scheme: by the trapezoidal rule, so that it is of second order too."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np

from torch_activegp.diagnosis.runs import Array

_MOST = 0.25
"""Of the least inertia at a joint: the mass matrix must stay positive, and so stiff a damper is implicit as it is."""
_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)
_AFFINE = int(mujoco.mjtBias.mjBIAS_AFFINE)


def halve_damping(model: mujoco.MjModel, field: Callable[[str], Array], rows: int) -> None:
    """Lets the damping of some simulations act with the mean of the velocities before and after each time step.

    Implicit integration takes the velocity after it, M dv = h (f - D (v + dv)), which is of first order. The mean is
    (M + h D / 2) dv = h (f - D v): the same with the inertia less h D / 2.

    Args:
        model: of all simulations, integrated with ``implicitfast``.
        field: gives a field of the model with one value for each simulation; time steps and dampings are set.
        rows: the first so many simulations.
    """
    servos = servo_damping(model)
    damping = field("dof_damping")[:rows]
    if not (damping.any() or servos.any()):
        return
    inertia = np.minimum(0.5 * field("opt.timestep")[:rows, None] * (damping + servos), _MOST / model.dof_invweight0)
    field("dof_armature")[:rows] -= inertia
    field("dof_M0")[:rows] -= inertia


def servo_damping(model: mujoco.MjModel) -> Array:
    """What drives of joints add to the damping by their own law, ``(nv,)``, N m s/rad or N s/m."""
    out = np.zeros(model.nv)
    for drive in range(model.nu):
        if model.actuator_trntype[drive] == _JOINT and model.actuator_biastype[drive] == _AFFINE:
            dof = model.jnt_dofadr[model.actuator_trnid[drive, 0]]
            out[dof] -= model.actuator_biasprm[drive, 2] * model.actuator_gear[drive, 0] ** 2
    return np.maximum(out, 0.0)
