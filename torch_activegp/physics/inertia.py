"""Rotor inertia, the centre of mass, and gravity."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.body import AXES, BodyEffect
from torch_activegp.physics.effect import Array, Effect, Index, Parameter
from torch_activegp.physics.joint import JointEffect, driven
from torch_activegp.physics.naming import joint_name
from torch_activegp.physics.place import Place
from torch_activegp.physics.rotor import add_rotor

_NOTHING = 1e-9
"""Part of the strongest pull of gravity that is rounding."""


class ArmatureError(JointEffect):
    """Inertia of a rotor behind a gear: MJCF's ``joint armature``."""

    name = "armature_error"
    law = "-J a"
    losses = frozenset({"armature"})
    needs_steps = False

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint; J is what comes on top of the model's own."""
        inertia = 1.0 / max(float(model.dof_invweight0[place.index]), 1e-12)
        unit = "kg m2" if place.position_unit == "rad" else "kg"
        own = float(model.dof_armature[place.index])
        parameter = Parameter("armature", unit, 0.05 * inertia, low=-0.9 * own)
        return cls.make(place, (parameter,), [[0.05 * inertia]], tunable=driven(place, model) or own > 0.0)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``dof_armature``."""
        add_rotor(field, rows, self.dof, values[:, 0])
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint armature``."""
        self.joint(spec).armature += float(values[0])
        return True


class CenterOfMassOffset(BodyEffect):
    """The centre of mass lies elsewhere along one axis of the body's frame, or several."""

    name = "center_of_mass_offset"
    law = "the body's centre of mass moves along its axes"
    vector = True

    @classmethod
    def along(cls, place: Place, size: float, *axes: int) -> Self:
        """Makes the effect along some axes of a body of a given size, m; more than one stand in for a single one."""
        names = tuple(AXES[axis] for axis in axes)
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
        pulls: see :func:`pulls_of_gravity`.
    """

    axes: tuple[int, ...] = (0, 1, 2)
    pulls: Mapping[str, Array] = dataclasses.field(default_factory=dict)

    name = "gravity_error"
    law = "gravity is another vector"
    vector = True

    @classmethod
    def along(cls, *axes: int, pulls: Mapping[str, Array] | None = None) -> Self:
        """Makes the effect along some axes of the world; more than one stand in for a single one."""
        names = tuple(AXES[axis] for axis in axes)
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
            pulls=pulls or {},
        )

    def push(self, values: Array, target: str) -> float:
        """The constant force on a slide, N; 0 on a joint that it pulls at in another way."""
        return float(values @ self.pulls[target][list(self.axes)]) if target in self.pulls else 0.0

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


def pulls_of_gravity(model: mujoco.MjModel) -> dict[str, Array]:
    """The force on each slide by its target in each axis' unit of gravity, where no joint before it turns it, kg."""
    data, out = mujoco.MjData(model), {}
    mujoco.mj_kinematics(model, data)
    slides, mass = model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE, model.body_mass * (1.0 - model.body_gravcomp)
    for body in range(model.nbody - 1, 0, -1):  # with all that it carries
        mass[model.body_parentid[body]] += mass[body]
    for joint in range(model.njnt):
        body = int(model.jnt_bodyid[joint])
        before = [other for other in range(joint + 1) if _carries(model, int(model.jnt_bodyid[other]), body)]
        if slides[before].all():
            name = joint_name(model, joint)
            out[f"joint:{name}"] = mass[body] * data.xaxis[joint]
    return out


def axes_of_gravity(model: mujoco.MjModel) -> tuple[int, ...]:
    """Axes of the world along which gravity pulls at a joint, as it stands at first or elsewhere: 0, 1 and 2.

    An arm that moves in a plane feels two of them, a slide on rails one: others would be tried in vain.
    """
    data, mass = mujoco.MjData(model), model.body_mass * (1.0 - model.body_gravcomp)
    rng, jacobian, felt = np.random.default_rng(0), np.zeros((3, model.nv)), np.zeros(3)
    for size in (0.0, 1.0, 1.0, 1.0):
        mujoco.mj_integratePos(model, data.qpos, size * rng.standard_normal(model.nv), 1.0)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        pulls = np.zeros((3, model.nv))
        for body in range(1, model.nbody):
            mujoco.mj_jacBodyCom(model, data, jacobian, None, body)
            pulls += mass[body] * jacobian
        felt = np.maximum(felt, abs(pulls).max(axis=1, initial=0.0))
    return tuple(int(axis) for axis in np.flatnonzero(felt > _NOTHING * felt.max()))


def _carries(model: mujoco.MjModel, body: int, other: int) -> bool:
    """Whether a body is another one, or carries it."""
    while other > body:
        other = int(model.body_parentid[other])
    return other == body
