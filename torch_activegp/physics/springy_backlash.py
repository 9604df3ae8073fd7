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
        """Moves the rotor in short steps against a joint that speeds up as in the last step, and pushes the joint."""
        assert memory is not None
        q, v, dt = step.qpos[rows, self.qpos], step.qvel[rows, self.dof], step.dt[rows]
        torque, half = self._torque(step.ctrl[rows]), 0.5 * values[:, 0]
        new = np.isnan(memory[:, 4])
        if new.any():
            q, v = self._pressed(step, rows, new, values, memory, torque)
        place, speed, _, _, _, last = memory.T
        alone = np.where(last > 0.0, (v - memory[:, 2]) / np.where(last > 0.0, last, 1.0), memory[:, 2])
        alone = alone - memory[:, 3] / self.load
        count = int(np.clip(np.ceil(dt.max() * np.sqrt(values[:, 1].max() / self.light) / _CLOSE), 1, _PARTS))
        h = dt / count
        stiffness = np.minimum(values[:, 1], self.light * (_STABLE / h) ** 2)
        damping = np.minimum(values[:, 2], _STABLE * self.light / h)
        after, faster, face = speed, speed - v, np.zeros_like(v)
        twist, moved = place - q + (step.middle - 0.5) * dt * faster, np.zeros_like(v)
        for _ in range(count):
            off = twist + 0.5 * h * faster
            side = np.sign(off) * (np.abs(off) > half)
            push = stiffness * (off - side * half) + damping * faster
            touch = np.where(side * push > 0.0, push, 0.0)
            before, after = after, (after + h * (torque - touch) / self.rotor) / (1.0 + h * self.drag / self.rotor)
            faster = faster + (after - before) - h * (alone + touch / self.load)
            twist = off + 0.5 * h * faster
            moved, face = moved + 0.5 * h * (before + after), face + touch / count
        memory[:, 0] = place + np.where(step.middle > 0.0, moved, dt * after)
        memory[:, 1:4] = np.stack([after, v, face], axis=1)
        memory[:, 5] = dt
        step.force[rows, self.dof] += face - torque

    def _pressed(
        self, step: Step, rows: Index, new: NDArray[np.bool_], values: Array, memory: Array, torque: Array
    ) -> tuple[Array, Array]:
        """Begins with a rotor in flight or pressed against an end; position and speed of the joint behind it."""
        q, v, half = step.qpos[rows, self.qpos], step.qvel[rows, self.dof], 0.5 * values[:, 0]
        pushes = torque - self.drag * v
        acceleration, (off, faster, side) = memory[:, 0].copy(), self._begin(memory, pushes)
        force = side * np.maximum(side * (pushes - self.rotor * acceleration), 0.0)
        pressed = side * half + force / np.maximum(values[:, 1], 1e-12)
        off, faster = np.where(side != 0.0, pressed, off), np.where(side != 0.0, 0.0, faster)
        q, v = self._joint_behind(step, rows, new, q, v, off, faster)
        begun = np.stack([q + off, v + faster, acceleration, force, 0.0 * v, 0.0 * v], axis=1)
        memory[new] = begun[new]
        return q, v

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
