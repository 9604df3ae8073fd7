"""Dry friction of bristles, which bend a little before a joint slides."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Array, Index, Parameter, Step
from torch_activegp.physics.friction import CoulombFriction, DryFriction, StribeckFriction
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


@dataclasses.dataclass(frozen=True, eq=False)
class _Bristled(DryFriction):
    """Base of the frictions of bristles: z' = v - |v| k z / g pushes the joint with k z + d z', where g slides.

    Args:
        inertia: of the joint, kg m2 or kg.
        reach: how far the bristles may bend, rad or m.
        row: time between the rows of a recording, s.
        firm: whether it sticks firmly instead.

    Reference: Canudas de Wit, Olsson, Astrom, Lischinsky, *A new model for control of systems with friction*, IEEE
    Transactions on Automatic Control 40 (1995), eq. 2-3.
    """

    inertia: float = 1.0
    reach: float = np.inf
    row: float = 0.01
    firm: bool = False

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether the joint turns back in a run; else its bristles stay bent."""
        return place.turns_back and super().fits(place, model)

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint: the firm friction, with parameters and a first guess of its bristles."""
        firm, inertia = super().at(place, model), whole_inertia(model, place.index)
        per = f"{place.force_unit}/{place.position_unit}", f"{place.force_unit} s/{place.position_unit}"
        low, stiffness, high = (inertia * frequency**2 for frequency in (_SOFTEST, _SOFT, _STIFFEST))
        damping = 2.0 * _DAMPED * inertia * _SOFT
        bristles = (
            Parameter("stiffness", per[0], 0.2 * stiffness, low=low, high=high),
            Parameter("damping", per[1], 0.2 * damping, low=0.0, high=2.0 * inertia * _STIFFEST),
        )
        return dataclasses.replace(
            firm,
            parameters=(*firm.parameters, *bristles),
            seeds=np.array([[*firm.seeds[0], stiffness, damping]]),
            variant=BRISTLES,
            stands_in=True,
            inertia=inertia,
            reach=_REACH * max(place.position[1] - place.position[0], 1e-9),
            row=place.dt,
        )

    def level(self, speed: Array | float, values: Array) -> Array:
        """What slides at some speed, N m or N."""
        raise NotImplementedError

    def plausible(self, values: Array) -> bool:
        """Whether its bristles bend no farther than they may."""
        return super().plausible(values) and bool(self.level(0.0, values) < self.reach * values[-2])

    def anew(self) -> Self:
        """The firm friction, for nobody knows how far bristles are bent."""
        return dataclasses.replace(self, firm=True)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Takes the joint's own ``frictionloss`` away; the bristles have it."""
        if self.firm:
            return super().edit(field, rows, values)
        field("dof_frictionloss")[rows, self.dof] = 0.0
        return False

    def memory(self, positions: Array, starts: Array, values: Array) -> Array | None:
        """How hard the bristles push, and no last position, ``(rows, 2)``, from the run's positions up to there.

        Args:
            positions: smoothed positions of whole runs, ``(runs, T)``.
            starts: run and row at which each simulation starts, ``(rows, 2)``.
            values: ``(rows, P)``.
        """
        if self.firm:
            return super().memory(positions, starts, values)
        laws, which = np.unique(values, axis=0, return_inverse=True)
        run, row = starts[:, 0], starts[:, 1]
        pushes = [np.zeros((len(laws), len(positions)))]
        for moved in np.diff(positions[:, : row.max() + 1]).T:
            pushes.append(_bent(pushes[-1], moved, self.level(moved / self.row, laws[:, None]), laws[:, -2:-1]))
        pushing = np.array(pushes)[row, which.reshape(-1), run]
        return np.stack([pushing, np.full(len(starts), np.nan)], axis=1)

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Bends the bristles, which push the joint."""
        if self.firm:
            return self._hold(step, rows, values)
        assert memory is not None
        level = self.level(step.qvel[rows, self.dof], values)
        stiffness, damping = _within_steps(values[:, -2], values[:, -1], self.inertia, step.dt[rows])
        position, before = step.position(rows, self.qpos, self.dof), memory[:, 0].copy()
        memory[:, 0] = _bent(before, np.nan_to_num(position - memory[:, 1]), level, stiffness)
        memory[:, 1] = position
        faster = (memory[:, 0] - before) / (stiffness * step.dt[rows])
        step.force[rows, self.dof] -= memory[:, 0] + damping * faster
        return None

    def _hold(self, step: Step, rows: Index, values: Array) -> None:
        """What the firm friction does before each step."""

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """MJCF has LuGre's friction in a DC motor alone: explicit, and with bristles unbent as a simulation begins."""
        return False


@dataclasses.dataclass(frozen=True, eq=False)
class BristledCoulomb(_Bristled, CoulombFriction):
    """-F sign(v), by bristles that bend before the joint slides: LuGre's friction with one level."""

    law = "-F sign(v), by bristles that bend before it slides"
    never_negative = frozenset({"stiffness", "damping"})
    needs_steps = True

    def level(self, speed: Array | float, values: Array) -> Array:
        """The same at any speed."""
        return np.asarray(self.nominal_loss + values[..., 0])


@dataclasses.dataclass(frozen=True, eq=False)
class BristledStribeck(_Bristled, StribeckFriction):
    """Stribeck friction by bristles that bend before the joint slides: LuGre's friction."""

    law = "-(F + (S - F) exp(-(v/w)^2)) sign(v), by bristles that bend before it slides"
    never_negative = StribeckFriction.never_negative | BristledCoulomb.never_negative

    def level(self, speed: Array | float, values: Array) -> Array:
        """Static friction at rest, Coulomb friction at speed."""
        return np.asarray(self.nominal_loss + self.added(speed, np.moveaxis(values, -1, 0)))

    def _hold(self, step: Step, rows: Index, values: Array) -> None:
        StribeckFriction.before_step(self, step, rows, values, None)

    def describe(self, values: Array) -> dict[str, float]:
        """Coulomb level, static level, Stribeck velocity, and the bristles."""
        return {**super().describe(values), "stiffness": float(values[-2]), "damping": float(values[-1])}


def _within_steps(stiffness: Array, damping: Array, inertia: float, dt: Array) -> tuple[Array, Array]:
    """As much of the stiffness and damping of bristles as time steps allow, ``(n,)`` each.

    Args:
        stiffness: N m/rad or N/m, ``(n,)``.
        damping: N m s/rad or N s/m, ``(n,)``.
        inertia: of the joint, kg m2 or kg.
        dt: length of the time step, ``(n,)``, s.
    """
    return np.minimum(stiffness, _STABLE * inertia / dt**2), np.minimum(damping, _STABLE * inertia / dt)


def _bent(before: Array, moved: Array, level: Array, stiffness: Array) -> Array:
    """How hard bristles push after joints moved, N m or N, by the exact solution for a level that stays."""
    most = np.maximum(level, 1e-12)
    end = np.sign(moved) * most
    return np.asarray(end + (before - end) * np.exp(-np.abs(moved) * stiffness / most))


BRISTLED_FORMS: tuple[type[_Bristled], ...] = (BristledCoulomb, BristledStribeck)
"""In place of a firm dry friction."""
