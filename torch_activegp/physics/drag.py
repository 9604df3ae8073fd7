"""Drag on a joint: friction that grows with speed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Array, Index, Parameter, Step
from torch_activegp.physics.joint import JointEffect
from torch_activegp.physics.place import Place

_SMALL = 0.05


class ViscousFriction(JointEffect):
    """-c v: MJCF's ``joint damping``, first coefficient."""

    name = "viscous_friction"
    law = "-c v"
    losses = frozenset({"coefficient"})
    needs_steps = False

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint; c is what comes on top of the model's own damping."""
        scale = _SMALL * place.force / place.speed
        unit = f"{place.force_unit} s/{place.position_unit}"
        parameter = Parameter("coefficient", unit, scale, low=-float(model.dof_damping[place.index]))
        return cls.make(place, (parameter,), [[scale]], tunable=True)

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return -values[0] * velocity

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``dof_damping``."""
        field("dof_damping")[rows, self.dof] += values[:, 0]
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint damping``."""
        self.joint(spec).damping[0] += float(values[0])
        return True


class QuadraticDrag(JointEffect):
    """-c v abs(v): MJCF's ``joint damping``, second coefficient."""

    name = "quadratic_drag"
    law = "-c v |v|"
    losses = frozenset({"coefficient"})
    needs_steps = False

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        scale = _SMALL * place.force / place.speed**2
        unit = f"{place.force_unit} s2/{place.position_unit}2"
        parameter = Parameter("coefficient", unit, scale, low=-float(model.dof_dampingpoly[place.index, 0]))
        return cls.make(place, (parameter,), [[scale]])

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return -values[0] * velocity * np.abs(velocity)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``dof_dampingpoly``."""
        field("dof_dampingpoly")[rows, self.dof, 0] += values[:, 0]
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint damping``."""
        self.joint(spec).damping[1] += float(values[0])
        return True


class AsymmetricFriction(JointEffect):
    """-c+ v for v > 0 and -c- v for v < 0: friction that depends on the direction."""

    name = "asymmetric_friction"
    law = "-c+ v for v > 0, -c- v for v < 0"
    losses = frozenset({"positive", "negative"})
    covers = ("viscous_friction",)

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether the joint goes both ways; what goes one way shows one level."""
        return place.both_ways

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        scale = _SMALL * place.force / place.speed
        unit, low = f"{place.force_unit} s/{place.position_unit}", -float(model.dof_damping[place.index])
        parameters = (Parameter("positive", unit, scale, low=low), Parameter("negative", unit, scale, low=low))
        return cls.make(place, parameters, [[scale, scale]], linear=2)

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return -np.where(velocity > 0, values[0], values[1]) * velocity

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds the mean of both to ``dof_damping``."""
        field("dof_damping")[rows, self.dof] += values.mean(axis=1)
        return False

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Adds half the difference times the speed, always in one direction."""
        speed = np.abs(step.qvel[rows, self.dof])
        step.force[rows, self.dof] -= 0.5 * (values[:, 0] - values[:, 1]) * speed
