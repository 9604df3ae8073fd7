"""Mass, its place, rotor inertia and gravity."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Self

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from torch_activegp.physics.effect import Array, Effect, Index, Parameter, Place, add_rotor, element
from torch_activegp.physics.joint import JointEffect

_AXES = "xyz"


class ArmatureError(JointEffect):
    """Inertia of a rotor behind a gear: MJCF's ``joint armature``."""

    name = "armature_error"
    law = "-J a"
    tunable = True
    needs_steps = False

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint; J is what comes on top of the model's own."""
        inertia = 1.0 / max(float(model.dof_invweight0[place.index]), 1e-12)
        unit = "kg m2" if place.position_unit == "rad" else "kg"
        low = -0.9 * float(model.dof_armature[place.index])
        return cls.make(place, (Parameter("armature", unit, 0.05 * inertia, low=low),), [[0.05 * inertia]])

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``dof_armature``."""
        add_rotor(field, rows, self.dof, values[:, 0])
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint armature``."""
        self.joint(spec).armature += float(values[0])
        return True


_BEYOND = 1.2
"""A load may stick out of the body that carries it, by a fifth of the way to its end."""
_INERTIAL = ("body_mass", "body_ipos", "body_inertia", "body_iquat", "body_simple")


@dataclasses.dataclass(frozen=True, eq=False)
class BodyEffect(Effect):
    """Base of the effects on a body.

    Args:
        body: the body's id.
        offset: where a payload sits from the body's centre of mass, m, body frame, ``(3,)``.
        axes: directions of the centre's displacement: 0, 1 and 2 for x, y and z of the body's frame.
    """

    body: int = 0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: tuple[int, ...] = (0,)

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``inertial`` as the edited model has it, unless the compiler would overrule it."""
        options = spec.compiler
        overruled = options.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
        if overruled or options.settotalmass > 0.0 or options.fusestatic:
            return False
        model = spec.copy().compile()
        fields = {name: getattr(model, name)[None].copy() for name in _INERTIAL}
        self.edit(fields.__getitem__, np.array([0]), np.asarray(values, dtype=float)[None])
        body: mujoco.MjsBody = element(spec, spec.bodies, self.target)
        mass, center, inertia, axes, _ = (fields[name][0, self.body] for name in _INERTIAL)
        body.explicitinertial, body.fullinertia[0] = True, np.nan
        body.mass, body.ipos, body.inertia, body.iquat = float(mass), center, inertia, axes
        body.ialt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
        return True


class PayloadMass(BodyEffect):
    """A point mass on a body, at its centre of mass or at an offset from there."""

    name = "payload_mass"
    law = "a point mass m on the body"

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
        parameter = Parameter("mass", "kg", 0.05 * mass, low=-share * mass)
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

    def offsets(self, values: Array) -> Array:
        """Where the payload sits in each simulation, m from the body's centre of mass, ``(rows, 3)``."""
        return np.tile(np.array(self.offset), (len(values), 1))


class PayloadAlong(PayloadMass):
    """A point mass somewhere between a body's centre of mass and its end, or a little beyond."""

    law = "a point mass m on the line from the body's centre of mass to its end"

    @classmethod
    def at(
        cls, place: Place, model: mujoco.MjModel, offset: Sequence[float] | Array = (0, 0, 0), variant: str = "along"
    ) -> Self:
        """Makes the effect for a body whose end is at an offset from its centre of mass."""
        end = PayloadMass.at(place, model, offset)
        reach = float(np.linalg.norm(end.offset))
        distance = Parameter("distance", "m", 0.05 * reach, low=-_BEYOND * reach, high=_BEYOND * reach)
        seeds = np.array([[*end.seeds[0], 0.5 * reach]])
        return dataclasses.replace(
            cls(place.target, (*end.parameters, distance), seeds, variant=variant),
            body=end.body,
            offset=end.offset,
            stands_in=True,
        )

    def offsets(self, values: Array) -> Array:
        """The distance in the direction of the end."""
        direction = np.array(self.offset) / np.linalg.norm(self.offset)
        return np.asarray(values[:, 1:] * direction)


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

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a body."""
        mass = float(model.body_mass[place.index])
        parameter = Parameter("mass", "kg", 0.05 * mass, low=-0.5 * mass)
        return cls(place.target, (parameter,), np.array([[0.05 * mass]]), variant="density", body=place.index)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Scales mass and inertia."""
        mass, inertia = field("body_mass"), field("body_inertia")
        ratio = 1.0 + values[:, 0] / mass[rows, self.body]
        mass[rows, self.body] *= ratio
        inertia[rows, self.body] *= ratio[:, None]
        return True


class CenterOfMassOffset(BodyEffect):
    """The centre of mass lies elsewhere along one or two axes of the body's frame."""

    name = "center_of_mass_offset"
    law = "the body's centre of mass moves along its axes"

    @classmethod
    def along(cls, place: Place, size: float, *axes: int) -> Self:
        """Makes the effect along some axes of a body of a given size, m; more than one stand in for a single one."""
        names = tuple(_AXES[axis] for axis in axes)
        parameters = tuple(Parameter(f"offset_{name}", "m", 0.03 * size, low=-size, high=size) for name in names)
        return cls(
            place.target,
            parameters,
            np.full((1, len(axes)), 0.03 * size),
            linear=len(axes),
            variant="".join(names),
            stands_in=len(axes) > 1,
            body=place.index,
            axes=axes,
        )

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Moves ``body_ipos``."""
        field("body_simple")[rows, self.body] = 0
        for axis, shift in zip(self.axes, values.T, strict=True):
            field("body_ipos")[rows, self.body, axis] += shift
        return True


@dataclasses.dataclass(frozen=True, eq=False)
class GravityError(Effect):
    """Gravity differs in size or direction: MJCF's ``option gravity``.

    Args:
        axes: 0, 1 and 2 for x, y and z of the world.
    """

    axes: tuple[int, ...] = (0, 1, 2)

    name = "gravity_error"
    law = "gravity is another vector"

    @classmethod
    def along(cls, *axes: int) -> Self:
        """Makes the effect along some axes of the world; more than one stand in for a single one."""
        names = tuple(_AXES[axis] for axis in axes)
        parameters = tuple(Parameter(f"change_{name}", "m/s2", 0.3) for name in names)
        seed = np.full((1, len(axes)), 0.3)
        return cls(
            "world",
            parameters,
            seed,
            linear=len(axes),
            variant="".join(names),
            stands_in=len(axes) > 1,
            axes=axes,
        )

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Changes ``opt.gravity``."""
        gravity = field("opt.gravity")
        for axis, change in zip(self.axes, values.T, strict=True):
            gravity[rows, axis] += change
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``option gravity``."""
        gravity = np.array(spec.option.gravity)
        gravity[list(self.axes)] += values
        spec.option.gravity = gravity
        return True
