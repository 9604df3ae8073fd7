"""Damping at the speed that a time step begins with: semi-implicit Euler as most simulators but MuJoCo have it."""

from __future__ import annotations

import copy

import mujoco

_IMPLICIT_OFF = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)


def is_explicit(model: mujoco.MjModel) -> bool:
    """Whether a model integrates so: MuJoCo's own ``Euler`` takes damping at the speed that a step ends with."""
    euler = int(model.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_EULER)
    return euler and bool(model.opt.disableflags & _IMPLICIT_OFF)


def make_explicit(option: mujoco.MjOption | mujoco.MjsOption) -> None:
    """Lets a model integrate so, by its options, or those of a model that is being edited."""
    option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    option.disableflags |= _IMPLICIT_OFF


def explicit(model: mujoco.MjModel) -> mujoco.MjModel:
    """A copy of a model that integrates so."""
    made = copy.copy(model)
    make_explicit(made.opt)
    return made
