"""Mass that a body carries, or has more of."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Self

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from torch_activegp.physics.body import AXES, BodyEffect
from torch_activegp.physics.effect import Array, Effect, Index, Parameter
from torch_activegp.physics.place import Place

_HEAVIEST = 4.0
"""A body's own mass may be wrong by so much of it; more is a load."""
_LOADED = 4.0
"""A load weighs no more than so many times the whole machine."""
_BEYOND = 1.2
"""A load may stick out of the body that carries it, by a fifth of the way to its end, or to its farthest part."""


class PayloadMass(BodyEffect):
    """A point mass on a body, at its centre of mass or at an offset from there."""

    name = "payload_mass"
    law = "a point mass m on the body"
    losses = frozenset({"mass"})

    @classmethod
    def at(
        cls, place: Place, model: mujoco.MjModel, offset: Sequence[float] | Array = (0, 0, 0), variant: str = "center"
    ) -> Self:
        """Makes the effect for a body; what may be missing from the model leaves it at least a tenth of its inertia."""
        offset = np.asarray(offset, dtype=float)
        mass, inertia = float(model.body_mass[place.index]), model.body_inertia[place.index]
        principal = Rotation.from_quat(model.body_iquat[place.index], scalar_first=True).inv().apply(offset)
        arms = offset @ offset - principal**2
        ratio = float(np.min(np.where(arms > 1e-12, 0.9 * inertia / (mass * np.maximum(arms, 1e-12)), 1.0)))
        share = min(0.5, ratio / (1.0 + ratio))
        x, y, z = map(float, offset)
        heaviest = _LOADED * max(float(model.body_mass.sum()), mass)
        parameter = Parameter("mass", "kg", 0.05 * mass, low=-share * mass, high=heaviest)
        seeds = np.array([[0.05 * mass]])
        return cls(place.target, (parameter,), seeds, variant=variant, body=place.index, offset=(x, y, z))

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Moves mass, centre of mass and inertia of the body to those of both together."""
        mass, inertia, center, axes = (field(name) for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat"))
        extra, old = values[:, 0], mass[rows, self.body]
        total = np.maximum(old + extra, 1e-9)
        offset = self.offsets(values)
        if offset.any():
            field("body_simple")[rows, self.body] = 0
            reduced = (old * extra / total)[:, None, None]
            turned = Rotation.from_quat(axes[rows, self.body], scalar_first=True)
            local = turned.inv().apply(offset)
            squares = (offset**2).sum(axis=1)[:, None, None]
            arms = squares * np.eye(3) - local[:, :, None] * local[:, None, :]
            tensor = inertia[rows, self.body][:, :, None] * np.eye(3) + reduced * arms
            inertia[rows, self.body], turn = _principal(tensor)
            axes[rows, self.body] = (turned * turn).as_quat(scalar_first=True)
        center[rows, self.body] += (extra / total)[:, None] * offset
        mass[rows, self.body] = total
        return True

    def law_with(self, values: Array) -> str:
        """The law, and where the payload sits."""
        place = ", ".join(f"{offset:.3g}" for offset in self.offsets(values[None])[0] + 0.0)
        return f"a point mass m at ({place}) m from the body's nominal centre of mass, in the body's frame"

    def offsets(self, values: Array) -> Array:
        """Where the payload sits in each simulation, m from the body's centre of mass, ``(rows, 3)``."""
        return np.tile(np.array(self.offset), (len(values), 1))


class PayloadAlong(PayloadMass):
    """A point mass on the line through a body's centre of mass and its end; a load only, nothing that is missing."""

    @classmethod
    def towards(cls, place: Place, model: mujoco.MjModel, reach: Array) -> Self:
        """Makes the effect for a body whose end is at an offset (not 0) from its centre of mass."""
        end = PayloadMass.at(place, model, reach)
        far = float(np.linalg.norm(reach))
        mass = dataclasses.replace(end.parameters[0], low=0.0)
        distance = Parameter("distance", "m", 0.05 * far, low=-_BEYOND * far, high=_BEYOND * far)
        seeds = np.array([[*end.seeds[0], 0.5 * far]])
        return cls(
            place.target, (mass, distance), seeds, variant="along", stands_in=True, body=end.body, offset=end.offset
        )

    def taking_over(self, other: Effect, values: Array) -> Array:
        """Begins where the other load sits, if that is not the centre."""
        begin = super().taking_over(other, values)
        if isinstance(other, PayloadMass) and other.offsets(values[None]).any():
            begin[1] = other.offsets(values[None])[0] @ self._direction
        return begin

    def offsets(self, values: Array) -> Array:
        """The distance in the direction of the end."""
        return np.asarray(values[:, 1:] * self._direction)

    @property
    def _direction(self) -> Array:
        return np.array(self.offset) / np.linalg.norm(self.offset)


@dataclasses.dataclass(frozen=True, eq=False)
class PayloadAside(PayloadMass):
    """A point mass somewhere in a plane through a body's centre of mass, or anywhere.

    Args:
        own: mass of the body in the model, kg.
        parent: id of the body that carries this one.
    """

    own: float = 0.0
    parent: int = 0

    @classmethod
    def within(cls, place: Place, model: mujoco.MjModel, reach: Array, axes: tuple[int, ...]) -> Self:
        """Makes the effect in the plane of two axes, or all three, of a body whose end is at an offset from its centre.

        It may sit as far from there as the end, or any other part of the body, does.
        """
        end = PayloadMass.at(place, model, reach)
        shapes = model.geom_bodyid == place.index
        parts = np.linalg.norm(model.geom_pos[shapes] - model.body_ipos[place.index], axis=1)
        parts += model.geom_rbound[shapes]
        end_at = float(np.linalg.norm(reach))
        far = _BEYOND * max([end_at, *parts.tolist()])
        names = tuple(AXES[axis] for axis in axes)
        mass = dataclasses.replace(end.parameters[0], low=0.0)
        places = tuple(Parameter(f"offset_{name}", "m", 0.05 * end_at, low=-far, high=far) for name in names)
        return cls(
            place.target,
            (mass, *places),
            np.array([[*end.seeds[0], *reach[list(axes)]]]),
            variant="".join(names),
            stands_in=True,
            body=end.body,
            axes=axes,
            own=float(model.body_mass[place.index]),
            parent=int(model.body_parentid[place.index]),
        )

    def moving(self, mass: float, there: Array, shift: Array) -> Array:
        """Parameters with which it moves the body's centre of mass farther than a load elsewhere does.

        Args:
            mass: of the load, kg.
            there: where the load was, m from the centre of mass, ``(3,)``.
            shift: by how much more the centre is to move, m, ``(3,)``.
        """
        place = (there + shift * (self.own + mass) / mass)[list(self.axes)]
        low, high = (np.array([getattr(p, end) for p in self.parameters]) for end in ("low", "high"))
        return np.clip(np.array([mass, *place]), low, high)

    def taking_over(self, other: Effect, values: Array) -> Array:
        """Begins where the other load sits."""
        begin = super().taking_over(other, values)
        if isinstance(other, PayloadMass):
            begin[1:] = other.offsets(values[None])[0, list(self.axes)]
        return begin

    def offsets(self, values: Array) -> Array:
        """The position along the axes."""
        out = np.zeros((len(values), 3))
        out[:, list(self.axes)] = values[:, 1:]
        return out


def _principal(tensor: Array) -> tuple[Array, Rotation]:
    """Principal moments ``(n, 3)`` of inertia tensors ``(n, 3, 3)``, and the turn to their axes."""
    moments = np.diagonal(tensor, axis1=1, axis2=2).copy()
    axes = np.broadcast_to(np.eye(3), tensor.shape).copy()
    tilted = np.abs(tensor - moments[:, :, None] * np.eye(3)).max(axis=(1, 2)) > 1e-9 * np.abs(moments).max(axis=1)
    if tilted.any():
        moments[tilted], axes[tilted] = np.linalg.eigh(tensor[tilted])
        axes[..., 0] *= np.linalg.det(axes)[:, None]
    return moments, Rotation.from_matrix(axes)


class DensityError(BodyEffect):
    """A body that is heavier by a factor everywhere: mass and inertia grow together."""

    name = "payload_mass"
    law = "the body's mass and inertia grow together"
    losses = frozenset({"mass"})

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a body."""
        mass = float(model.body_mass[place.index])
        parameter = Parameter("mass", "kg", 0.05 * mass, low=-0.5 * mass, high=_HEAVIEST * mass)
        return cls(place.target, (parameter,), np.array([[0.05 * mass]]), variant="density", body=place.index)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Scales mass and inertia."""
        mass, inertia = field("body_mass"), field("body_inertia")
        ratio = 1.0 + values[:, 0] / mass[rows, self.body]
        mass[rows, self.body] *= ratio
        inertia[rows, self.body] *= ratio[:, None]
        return True
