"""Dry friction as a simulator softens it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Self

import mujoco

from torch_activegp.physics.effect import Array, Index, Place
from torch_activegp.physics.friction import CoulombFriction


class SoftCoulombFriction(CoulombFriction):
    """-F sign(v), softened around v = 0 by the model's own ``solreffriction`` and ``solimpfriction``.

    MuJoCo's defaults let a stuck joint creep: below some speed the friction is viscous. Recordings that come from
    another simulation are fitted by this form; a real joint sticks as firmly as :class:`CoulombFriction` does.
    """

    law = "-F sign(v), softened as the model's solreffriction says"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        firm = CoulombFriction.at(place, model)
        return cls.make(place, firm.parameters, firm.seeds.tolist(), variant="soft", stands_in=True)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``dof_frictionloss`` alone."""
        self.add_loss(field, rows, values)
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint frictionloss`` alone."""
        self.write_loss(spec, values)
        return True
