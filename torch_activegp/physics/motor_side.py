"""Play between a motor and its joint, where the encoder sits on the motor: the joint is hidden, and not the rotor."""

from __future__ import annotations

import dataclasses
from typing import Self

import mujoco

from torch_activegp.physics.backlash import Backlash, DampedBacklash, RestingBacklash
from torch_activegp.physics.place import Place
from torch_activegp.physics.springy_backlash import SpringyBacklash, SpringyDampedBacklash

_LAW = "; the encoder sits on the motor"


@dataclasses.dataclass(frozen=True, eq=False)
class MotorSideBacklash(RestingBacklash):
    """Backlash behind the encoder of a motor; the motor begins on the side where it must push."""

    law = RestingBacklash.law + _LAW

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`; it stands in for no other form, which would not show it."""
        return dataclasses.replace(super().at(place, model), variant="motor side", stands_in=False, on_motor=True)


@dataclasses.dataclass(frozen=True, eq=False)
class MotorSideDampedBacklash(DampedBacklash):
    """The same where the joint's damping is that of the motor and its gears."""

    law = DampedBacklash.law + _LAW

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`."""
        return dataclasses.replace(
            super().at(place, model), variant="motor side, damped rotor", centred=False, on_motor=True
        )


@dataclasses.dataclass(frozen=True, eq=False)
class MotorSideSpringyBacklash(SpringyBacklash):
    """The same with ends that give way."""

    law = SpringyBacklash.law + _LAW

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`."""
        return dataclasses.replace(
            super().at(place, model), variant="motor side, springy", centred=False, on_motor=True
        )


@dataclasses.dataclass(frozen=True, eq=False)
class MotorSideSpringyDampedBacklash(SpringyDampedBacklash):
    """The same with ends that give way, where the joint's damping is the rotor's."""

    law = SpringyDampedBacklash.law + _LAW

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`."""
        return dataclasses.replace(
            super().at(place, model), variant="motor side, springy, damped rotor", centred=False, on_motor=True
        )


MOTOR_SIDE: tuple[type[Backlash], ...] = (
    MotorSideBacklash,
    MotorSideDampedBacklash,
    MotorSideSpringyBacklash,
    MotorSideSpringyDampedBacklash,
)
"""The family, on joints with a motor."""
