"""Controls that a model holds within limits."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray


def clipped_controls(model: mujoco.MjModel) -> NDArray[np.bool_]:
    """Which controls are held within their limits, ``(nu,)``: none where the model's ``clampctrl`` flag is off."""
    clamped = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL)
    return clamped & model.actuator_ctrllimited[: model.nu].astype(bool)
