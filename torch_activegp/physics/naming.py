"""How elements of a model are called: by their own names, or by their kind and their number where they have none."""

from __future__ import annotations

from typing import SupportsIndex

import mujoco


def joint_name(model: mujoco.MjModel, joint: SupportsIndex) -> str:
    """The name of a joint by its id, such as ``elbow`` or ``joint1``."""
    return model.joint(int(joint)).name or f"joint{joint}"


def actuator_name(model: mujoco.MjModel, actuator: SupportsIndex) -> str:
    """The name of an actuator by its id, such as ``elbow_motor`` or ``actuator1``."""
    return model.actuator(int(actuator)).name or f"actuator{actuator}"
