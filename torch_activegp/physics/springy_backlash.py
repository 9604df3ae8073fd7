"""Play between a motor and its joint whose ends give way."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from torch_activegp.physics.backlash import Backlash, DampedBacklash
from torch_activegp.physics.effect import Array, Index, Parameter, Step
from torch_activegp.physics.place import Place
from torch_activegp.physics.rotor import add_rotor, whole_inertia

_LEAST = 1e-9
_SOFTEST, _SOFT, _STIFFEST = 15.0, 80.0, 600.0
"""Natural frequencies of a rotor on the ends of a gap, rad/s: least, first guess, most."""
_DAMPED = 0.7
_CLOSE, _PARTS = 0.1, 12
"""Radians of its natural frequency in a part of a time step, and parts at most."""
_STABLE = 0.5
"""And in the longest part: what is stiffer is simulated so, or it would be unstable."""
_HEAVY = 1.0
"""Square of the radians by which ends that hold on to a joint alone would turn it in a whole time step, at most: its
inertia is that of one pose, and a folded arm has a quarter of that."""


@dataclasses.dataclass(frozen=True, eq=False)
class SpringyBacklash(Backlash):
    """The same with ends that give way: a spring and a damper that only push, as of gears, belts and couplings.

    Args:
        load: inertia of what hangs on the joint, without the rotor, kg m2 or kg.
    """

    load: float = 1.0

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
        whole = whole_inertia(model, place.index)
        load = max(whole - firm.armature, _LEAST * whole)
        seeds = np.array([[0.015 * firm.parameters[0].high, stiffness, damping]])
        return dataclasses.replace(
            firm, parameters=parameters, seeds=seeds, variant="springy", stands_in=True, load=load
        )

    @property
    def light(self) -> float:
        """Inertia with which rotor and joint move against each other, kg m2 or kg."""
        return 1.0 / (1.0 / self.rotor + 1.0 / self.load)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Takes the rotor and its drag off the joint, which they never move with."""
        add_rotor(field, rows, self.dof, np.full(len(rows), -self.armature), -self.drag)
        return False

    def absent(self, values: Array) -> Array:
        """No gap, and ends as firm as they may be."""
        return np.array([0.0, self.parameters[1].high, 0.5 * self.parameters[2].high])

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Moves the rotor in parts of the step, in which it alone moves the joint, and pushes the joint.

        Its memory is the rotor's position and speed, and the time step, last; the rest serves the first step alone.
        """
        assert memory is not None
        q, v, dt = step.qpos[rows, self.qpos], step.qvel[rows, self.dof], step.dt[rows]
        torque, half = self._torque(step.ctrl[rows]), 0.5 * values[:, 0]
        new = np.isnan(memory[:, 4])
        if new.any():
            q, v = self._pressed(step, rows, new, values, memory, torque)
        place, speed, last = memory[:, 0], memory[:, 1], memory[:, 5]
        parts = np.ceil(np.nan_to_num(dt * np.sqrt(values[:, 1] / self.light) / _CLOSE)).clip(1, _PARTS)
        h = dt / parts
        stiffness = np.minimum(values[:, 1], np.minimum(self.light * (_STABLE / h) ** 2, _HEAVY * self.load / dt**2))
        damping = np.minimum(values[:, 2], _STABLE * self.light / h)
        after, faster, pushed, moved = speed, speed - v, np.zeros_like(v), np.zeros_like(v)
        behind = 0.0 if step.middle else 0.5 * np.where(last > 0.0, last, dt)  # speeds are of half a step before
        twist = place - q - behind * faster
        length = h * (np.arange(int(parts.max()))[:, None] < parts)  # none for those that are done
        slowed = 1.0 / (1.0 + length * (self.drag / self.rotor))
        for part, middle, keeps in zip(length, 0.5 * length, slowed, strict=True):
            off = twist + middle * faster
            pressed = off - np.minimum(np.maximum(off, -half), half)
            push = stiffness * pressed + damping * faster
            push = np.where(push * pressed > 0.0, push, 0.0)  # ends only push
            slow, after = after, keeps * (after + part * (torque - push) / self.rotor)
            faster = faster + (after - slow - part * push / self.load)
            twist = off + middle * faster
            moved += middle * (slow + after)
            pushed += part * push
        memory[:, 0] = place + (moved if step.middle else dt * after)
        memory[:, 1], memory[:, 5] = after, dt
        step.force[rows, self.dof] += pushed / dt - torque

    def _pressed(
        self, step: Step, rows: Index, new: NDArray[np.bool_], values: Array, memory: Array, torque: Array
    ) -> tuple[Array, Array]:
        """Begins with a rotor in flight or pressed against an end; returns position and speed of the joint."""
        q, v, half = step.qpos[rows, self.qpos], step.qvel[rows, self.dof], 0.5 * values[:, 0]
        pushes = torque - self.drag * v
        acceleration, (off, faster, side) = memory[:, 0], self._begin(memory, pushes)
        pressed = np.maximum(side * (pushes - self.rotor * acceleration), 0.0) / np.maximum(values[:, 1], 1e-12)
        off, faster = np.where(side != 0.0, side * (half + pressed), off), np.where(side != 0.0, 0.0, faster)
        q = self._joint_behind(step, rows, new, q, off)
        memory[new, 0], memory[new, 1], memory[new, 4:] = (q + off)[new], (v + faster)[new], 0.0
        return q, v

    def show(self, qpos: Array, qvel: Array, rows: Index, values: Array, memory: Array | None) -> None:
        """Puts the rotor in place of the joint where the encoder sits on it."""
        if self.on_motor and memory is not None:
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
