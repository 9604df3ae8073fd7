"""Limits that a model holds controls within."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

_NONE = [[-np.inf], [np.inf]]


def control_limits(model: mujoco.MjModel) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Least and largest value of each control, ``(nu,)``; infinite where MuJoCo clips none, as with ``clampctrl`` off.

    Args:
        model: as its user made it; an engine's own copy never clips.
    """
    clips = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    low, high = np.where(clips & model.actuator_ctrllimited.astype(bool), model.actuator_ctrlrange.T, _NONE)
    return low, high
