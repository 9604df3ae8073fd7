"""Dry friction of bristles, which bend a little before a joint slides."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Array, Index, Parameter, Step
from torch_activegp.physics.friction import CoulombFriction, StribeckFriction
from torch_activegp.physics.place import Place
from torch_activegp.physics.rotor import whole_inertia

BRISTLES = "bristles"
_SOFTEST, _SOFT, _STIFFEST = 15.0, 150.0, 1500.0
"""Natural frequencies of a joint on its bristles, rad/s: least, first guess, most."""
_DAMPED = 0.3
_STABLE = 0.5
"""Square of the radians by which bristles turn a joint in a time step, at most."""
_REACH = 2e-3
"""Part of the joint's range that bristles bend, at most: what bends farther is a hysteresis."""
_ROWS = 30
"""Of a recording before a simulation, in which bristles bend as they are when it begins."""


@dataclasses.dataclass(frozen=True, eq=False)
class BristledCoulomb(CoulombFriction):
    """-F sign(v), by bristles that bend before the joint slides: LuGre's friction with one level.

    Args:
        inertia: of the joint, kg m2 or kg.
        reach: how far the bristles may bend, rad or m.

    Reference: Canudas de Wit, Olsson, Astrom, Lischinsky, *A new model for control of systems with friction*, IEEE
    Transactions on Automatic Control 40 (1995), eq. 2-3.
    """

    inertia: float = 1.0
    reach: float = np.inf

    law = "-F sign(v), by bristles that bend before it slides"
    never_negative = frozenset({"stiffness", "damping"})
    needs_steps = True

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        firm = CoulombFriction.at(place, model)
        return cls.make(place, *_and_bristles(firm, place, model), tunable=firm.tunable, **_soft(place, model))

    def plausible(self, values: Array) -> bool:
        """Whether its bristles bend no farther than they may."""
        return super().plausible(values) and bool(self.level(0.0, values) < self.reach * values[-2])

    def level(self, speed: Array | float, values: Array) -> Array:
        """What slides at some speed, N m or N."""
        return np.asarray(self.nominal_loss + values[..., 0])

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Takes the joint's own ``frictionloss`` away; the bristles have it."""
        field("dof_frictionloss")[rows, self.dof] = 0.0
        return False

    def memory(self, positions: Array, starts: Array, values: Array) -> Array:
        """How far the bristles are bent, and no last position, ``(rows, 2)``; see `bent`."""
        return bent(positions, starts, self.level(0.0, values), values[:, -2])

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Bends the bristles, which push the joint."""
        assert memory is not None
        q = step.position(rows, self.qpos, self.dof)
        level = self.level(step.qvel[rows, self.dof], values)
        step.force[rows, self.dof] -= push(memory, q, level, values[:, -2:], step.dt[rows], self.inertia)

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes a passive DC motor with LuGre friction."""
        level = float(self.level(0.0, values))
        if level <= 0.0:
            return False
        self.joint(spec).frictionloss = 0.0
        self.add_passive(spec, lugre=[*map(float, values[-2:]), level, level, 1.0])
        return True


@dataclasses.dataclass(frozen=True, eq=False)
class BristledStribeck(StribeckFriction):
    """Stribeck friction by bristles that bend before the joint slides: LuGre's friction.

    Args:
        inertia: of the joint, kg m2 or kg.
        reach: how far the bristles may bend, rad or m.

    Reference: as :class:`BristledCoulomb`.
    """

    inertia: float = 1.0
    reach: float = np.inf

    law = "-(F + (S - F) exp(-(v/w)^2)) sign(v), by bristles that bend before it slides"
    never_negative = StribeckFriction.never_negative | BristledCoulomb.never_negative

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        firm = StribeckFriction.at(place, model)
        return cls.make(place, *_and_bristles(firm, place, model), linear=firm.linear, **_soft(place, model))

    def plausible(self, values: Array) -> bool:
        """Whether there is friction at speed too, and its bristles bend no farther than they may."""
        return super().plausible(values) and bool(self.level(0.0, values) < self.reach * values[-2])

    def level(self, speed: Array | float, values: Array) -> Array:
        """What slides at some speed, N m or N."""
        coulomb, excess, velocity = np.moveaxis(values[..., :3], -1, 0)
        return np.asarray(self.nominal_loss + coulomb + excess * np.exp(-((speed / velocity) ** 2)))

    edit = BristledCoulomb.edit
    memory = BristledCoulomb.memory
    before_step = BristledCoulomb.before_step

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes a passive DC motor with LuGre friction."""
        slides, static = (float(self.level(speed, values)) for speed in (np.inf, 0.0))
        if slides <= 0.0:
            return False
        self.joint(spec).frictionloss = 0.0
        self.add_passive(spec, lugre=[*map(float, values[-2:]), slides, static, float(values[2])])
        return True

    def describe(self, values: Array) -> dict[str, float]:
        """Coulomb level, static level, Stribeck velocity, and the bristles."""
        return {**super().describe(values), "stiffness": float(values[-2]), "damping": float(values[-1])}


def push(memory: Array, position: Array, level: Array, bristles: Array, dt: Array, inertia: float) -> Array:
    """Bends bristles by the way of their joints; how hard they hold these back, ``(n,)``, N m or N.

    Args:
        memory: how far they are bent, and where the joint was last, ``(n, 2)``; no number before the first step.
        position: of the joints, ``(n,)``, rad or m.
        level: what slides, ``(n,)``, N m or N.
        bristles: stiffness and damping, ``(n, 2)``; as much of them as time steps allow.
        dt: length of the step, ``(n,)``, s.
        inertia: of the joint, kg m2 or kg.
    """
    stiffness = np.minimum(bristles[:, 0], _STABLE * inertia / dt**2)
    damping = np.minimum(bristles[:, 1], _STABLE * inertia / dt)
    before = memory[:, 0].copy()
    memory[:, 0] = _bend(before, np.nan_to_num(position - memory[:, 1]), level, stiffness)
    memory[:, 1] = position
    return np.asarray(stiffness * memory[:, 0] + damping * (memory[:, 0] - before) / dt)


def bent(positions: Array, starts: Array, level: Array, stiffness: Array) -> Array:
    """How far bristles are bent as simulations begin, and no last position, ``(n, 2)``.

    Args:
        positions: smoothed positions of whole runs, ``(runs, T)``.
        starts: run and row at which each begins, ``(n, 2)``.
        level: what slides, ``(n,)``.
        stiffness: of the bristles, ``(n,)``.
    """
    rows = np.maximum(starts[:, 1:] + np.arange(-_ROWS, 1), 0)
    way = np.diff(positions[starts[:, :1], rows], axis=1)
    memory = np.stack([np.zeros(len(starts)), np.full(len(starts), np.nan)], axis=1)
    for moved in way.T:
        memory[:, 0] = _bend(memory[:, 0], moved, level, stiffness)
    return memory


def _bend(before: Array, moved: Array, level: Array, stiffness: Array) -> Array:
    """How far bristles are bent after joints moved, by the exact solution for a level that stays."""
    most = np.maximum(level, 1e-12) / stiffness
    end = np.sign(moved) * most
    return np.asarray(end + (before - end) * np.exp(-np.abs(moved) / most))


def _and_bristles(
    firm: CoulombFriction | StribeckFriction, place: Place, model: mujoco.MjModel
) -> tuple[tuple[Parameter, ...], list[list[float]]]:
    """Parameters and first guess of a friction with bristles."""
    inertia = whole_inertia(model, place.index)
    per = f"{place.force_unit}/{place.position_unit}", f"{place.force_unit} s/{place.position_unit}"
    low, stiffness, high = (inertia * frequency**2 for frequency in (_SOFTEST, _SOFT, _STIFFEST))
    damping = 2.0 * _DAMPED * inertia * _SOFT
    bristles = (
        Parameter("stiffness", per[0], 0.2 * stiffness, low=low, high=high),
        Parameter("damping", per[1], 0.2 * damping, low=0.0, high=2.0 * inertia * _STIFFEST),
    )
    return (*firm.parameters, *bristles), [[*firm.seeds[0], stiffness, damping]]


def _soft(place: Place, model: mujoco.MjModel) -> dict[str, Any]:
    """What both forms know of the joint."""
    reach = _REACH * max(place.position[1] - place.position[0], 1e-9)
    return {
        "variant": BRISTLES,
        "stands_in": True,
        "inertia": whole_inertia(model, place.index),
        "reach": reach,
    }


BRISTLED: tuple[type[CoulombFriction] | type[StribeckFriction], ...] = (BristledCoulomb, BristledStribeck)
"""The forms, in place of a firm dry friction."""
