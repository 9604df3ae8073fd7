"""Play between a motor and its joint, where the encoder sits on the motor: the joint is hidden, and not the rotor."""

from __future__ import annotations

import dataclasses
from typing import Self

import mujoco

from torch_activegp.physics.backlash import Backlash, DampedBacklash
from torch_activegp.physics.place import Place
from torch_activegp.physics.springy_backlash import SpringyBacklash, SpringyDampedBacklash

_LAW = "; the encoder sits on the motor"


class _MotorSide(Backlash):
    """Any form of backlash behind the encoder of a motor, which begins on the side where it must push."""

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`."""
        made = super().at(place, model)
        variant = ", ".join(filter(None, ("motor side", made.variant)))
        return dataclasses.replace(made, variant=variant, centred=False, on_motor=True)


class MotorSideBacklash(_MotorSide):
    """Backlash behind the encoder of a motor; it stands in for no other form, which would not show it."""

    law = Backlash.law + _LAW


class MotorSideDampedBacklash(_MotorSide, DampedBacklash):
    """The same where the joint's damping is that of the motor and its gears."""

    law = DampedBacklash.law + _LAW


class MotorSideSpringyBacklash(_MotorSide, SpringyBacklash):
    """The same with ends that give way."""

    law = SpringyBacklash.law + _LAW


class MotorSideSpringyDampedBacklash(_MotorSide, SpringyDampedBacklash):
    """The same with ends that give way, where the joint's damping is the rotor's."""

    law = SpringyDampedBacklash.law + _LAW


MOTOR_SIDE: tuple[type[Backlash], ...] = (
    MotorSideBacklash,
    MotorSideDampedBacklash,
    MotorSideSpringyBacklash,
    MotorSideSpringyDampedBacklash,
)
"""The family, on joints with a motor."""
