"""Dry friction as a simulator softens it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Array, Index
from torch_activegp.physics.friction import CoulombFriction
from torch_activegp.physics.place import Place

SOFT = "soft"


@dataclasses.dataclass(frozen=True, eq=False)
class SoftCoulombFriction(CoulombFriction):
    """-F sign(v), softened around v = 0 by the model's own ``solreffriction`` and ``solimpfriction``.

    MuJoCo's defaults let a stuck joint creep: below some speed the friction is viscous. Recordings that come from
    another simulation are fitted by this form; a real joint sticks as firmly as :class:`CoulombFriction` does.

    Args:
        solref: the model's own ``solreffriction``.
        solimp: the first two of its ``solimpfriction``.
    """

    solref: tuple[float, ...] = (0.02, 1.0)
    solimp: tuple[float, ...] = (0.9, 0.95)

    law = "-F sign(v), softened as the model's solreffriction says"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        firm = CoulombFriction.at(place, model)
        softness = {"solref": model.dof_solref[place.index], "solimp": model.dof_solimp[place.index, :2]}
        soft = {name: tuple(map(float, values)) for name, values in softness.items()}
        return cls.make(place, firm.parameters, firm.seeds.tolist(), variant=SOFT, stands_in=True, **soft)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``dof_frictionloss``, as soft as the model says."""
        self.add_loss(field, rows, values)
        field("dof_solref")[rows, self.dof] = self.solref
        field("dof_solimp")[rows, self.dof, :2] = self.solimp
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint frictionloss``, as soft as the model says."""
        self.write_loss(spec, values)
        joint = self.joint(spec)
        joint.solref_friction = np.array(self.solref)
        joint.solimp_friction = np.array([*self.solimp, *joint.solimp_friction[2:]])
        return True
