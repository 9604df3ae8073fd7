"""Friction that remembers where the joint has been."""

from __future__ import annotations

from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Array, Effect, Index, Parameter, Step
from torch_activegp.physics.joint import JointEffect
from torch_activegp.physics.place import Place

_SMALL = 0.05


class Hysteresis(JointEffect):
    """A spring with a slider: -k z, where z follows q and slips at +-s."""

    name = "hysteresis"
    never_negative = frozenset({"stiffness", "slip"})
    law = "-k z, z follows q and slips at +-s"

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether the joint turns back in a run; else a spring or a force says the same."""
        return place.turns_back

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint, with slips from 2 to 40 % of the range."""
        width = max(place.position[1] - place.position[0], 1e-9)
        parameters = (
            Parameter("stiffness", f"{place.force_unit}/{place.position_unit}", _SMALL * place.force / width, low=0.0),
            Parameter("slip", place.position_unit, 0.02 * width, low=2e-3 * width, high=width),
        )
        seeds = [[_SMALL * place.force / (share * width), share * width] for share in (0.02, 0.06, 0.15, 0.4)]
        return cls.make(place, parameters, seeds, linear=1)

    def memory(self, positions: Array, starts: Array, values: Array) -> Array:
        """The slider's deflection at the start of each simulation, from the run's positions up to there.

        Args:
            positions: smoothed positions of whole runs, ``(runs, T)``.
            starts: run and row at which each simulation starts, ``(rows, 2)``.
            values: ``(rows, P)``.

        Returns:
            Deflection and last position, ``(rows, 2)``.
        """
        slips, which = np.unique(values[:, 1], return_inverse=True)
        run, row = starts[:, 0], starts[:, 1]
        deflection = _deflections(positions[:, : row.max() + 1], slips[:, None])
        return np.stack([deflection[row, which, run], positions[run, row]], axis=1)

    def path(self, position: Array, values: Array) -> Array:
        """The force along given positions ``(n, T)``, with the slider's deflection zero in the beginning."""
        return -values[0] * _deflections(position, values[1]).T

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Moves the slider and adds the spring's force."""
        assert memory is not None
        position = step.position(rows, self.qpos, self.dof)
        moved = memory[:, 0] + position - memory[:, 1]
        memory[:, 0] = np.minimum(np.maximum(moved, -values[:, 1]), values[:, 1])
        memory[:, 1] = position
        step.force[rows, self.dof] -= values[:, 0] * memory[:, 0]


def _deflections(position: Array, slip: Array | float) -> Array:
    """Of sliders along positions ``(n, T)``, zero in the beginning: ``(T, ..., n)``, by slips that broadcast."""
    now = np.zeros(np.broadcast_shapes(np.shape(slip), position[:, 0].shape))
    out = [now]
    for move in np.diff(position).T:
        now = np.minimum(np.maximum(now + move, -slip), slip)  # np.clip takes four times as long
        out.append(now)
    return np.array(out)


MEMORY: tuple[type[Effect], ...] = (Hysteresis,)
"""The family, on every joint; those that want a motor there too are in :mod:`torch_activegp.physics.backlash`."""
