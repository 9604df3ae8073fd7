"""Play between a motor and its joint whose ends give way."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.backlash import Backlash, DampedBacklash
from torch_activegp.physics.effect import Array, Index, Parameter, Step
from torch_activegp.physics.place import Place
from torch_activegp.physics.rotor import add_rotor

_LEAST = 1e-9
_SOFTEST, _SOFT, _STIFFEST = 15.0, 80.0, 600.0
"""Natural frequencies of a rotor on the ends of a gap, rad/s: least, first guess, most."""
_DAMPED = 0.7
_STABLE = 0.5
"""Radians of its natural frequency in a time step: what is stiffer is simulated so, or steps would make it unstable."""


@dataclasses.dataclass(frozen=True, eq=False)
class SpringyBacklash(Backlash):
    """The same with ends that give way: a spring and a damper that only push, as of gears, belts and couplings.

    Args:
        light: inertia with which rotor and joint move against each other, kg m2 or kg.
    """

    light: float = 1.0

    never_negative = frozenset({"gap", "stiffness", "damping"})
    law = "the motor's torque reaches the joint only at the ends of a gap, which are springs and dampers"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`, with ends on which the rotor rings at 13 Hz."""
        firm = super().at(place, model)
        per = f"{place.force_unit}/{place.position_unit}", f"{place.force_unit} s/{place.position_unit}"
        stiffness, damping = firm.rotor * _SOFT**2, 2.0 * _DAMPED * firm.rotor * _SOFT
        low, high = firm.rotor * _SOFTEST**2, firm.rotor * _STIFFEST**2
        parameters = (
            *firm.parameters,
            Parameter("stiffness", per[0], 0.2 * stiffness, low=low, high=high),
            Parameter("damping", per[1], 0.2 * damping, low=0.0, high=2.0 * firm.rotor * _STIFFEST),
        )
        whole = 1.0 / max(float(model.dof_invweight0[place.index]), 1e-12)
        light = 1.0 / (1.0 / firm.rotor + 1.0 / max(whole - firm.armature, _LEAST * whole))
        seeds = np.array([[0.015 * firm.parameters[0].high, stiffness, damping]])
        return dataclasses.replace(
            firm, parameters=parameters, seeds=seeds, variant="springy", stands_in=True, light=light
        )

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Takes the rotor and its drag off the joint, which they never move with."""
        add_rotor(field, rows, self.dof, np.full(len(rows), -self.armature), -self.drag)
        return False

    def absent(self, values: Array) -> Array:
        """No gap, and ends as firm as they may be."""
        return np.array([0.0, self.parameters[1].high, 0.5 * self.parameters[2].high])

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Moves the rotor, and pushes the joint where it touches."""
        assert memory is not None
        q, v, dt = step.qpos[rows, self.qpos], step.qvel[rows, self.dof], step.dt[rows]
        torque, half = self._torque(step.ctrl[rows]), 0.5 * values[:, 0]
        stiffness = np.minimum(values[:, 1], self.light * (_STABLE / dt) ** 2)
        damping = np.minimum(values[:, 2], _STABLE * self.light / dt)
        new = np.isnan(memory[:, 4])
        if new.any():
            pushes = torque - self.drag * v
            acceleration, (off, faster, side) = memory[:, 0], self._begin(memory, pushes)
            pressed = np.maximum(side * (pushes - self.rotor * acceleration), 0.0) / np.maximum(values[:, 1], 1e-12)
            off, faster = np.where(side != 0.0, side * (half + pressed), off), np.where(side != 0.0, 0.0, faster)
            q, v = self._joint_behind(step, rows, new, q, v, off, faster)
            begun = np.stack([q + off, v + faster], axis=1)
            memory[new, :2], memory[new, 4] = begun[new], 0.0
        place, speed = memory[:, 0], memory[:, 1]
        off = place - q + step.middle * dt * (speed - v)
        side = np.sign(off) * (np.abs(off) > half)
        push = stiffness * (off - side * half) + damping * (speed - v)
        face = np.where(side * push > 0.0, push, 0.0)
        after = (speed + dt * (torque - face) / self.rotor) / (1.0 + dt * self.drag / self.rotor)
        memory[:, 0] = place + dt * (step.middle * speed + (1.0 - step.middle) * after)
        memory[:, 1] = after
        step.force[rows, self.dof] += face - torque

    def show(self, qpos: Array, qvel: Array, rows: Index, values: Array, memory: Array | None) -> None:
        """Puts the rotor in place of the joint where the encoder sits on it."""
        if self.seen and memory is not None:
            qpos[rows, self.qpos], qvel[rows, self.dof] = memory[:, 0], memory[:, 1]


@dataclasses.dataclass(frozen=True, eq=False)
class SpringyDampedBacklash(SpringyBacklash):
    """The same with ends that give way, where the joint's damping is the rotor's."""

    law = (
        "the motor's torque reaches the joint only at the ends of a gap, which are springs and dampers, and the "
        "joint's damping acts on the motor"
    )

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether the joint has viscous damping too."""
        return DampedBacklash.fits(place, model)

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint that :meth:`fits`."""
        drag = float(model.dof_damping[place.index])
        return dataclasses.replace(super().at(place, model), variant="springy, damped rotor", drag=drag)


SPRINGY_BACKLASH: tuple[type[SpringyBacklash], ...] = (SpringyBacklash, SpringyDampedBacklash)
"""The family, in place of a firm backlash."""
