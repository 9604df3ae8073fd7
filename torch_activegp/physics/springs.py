"""Springs and constant forces; with cogging and stops, the forces that depend on a joint's position."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, Self

import mujoco
import numpy as np

from torch_activegp.physics.cogging import Cogging
from torch_activegp.physics.effect import Array, Effect, Index, Parameter
from torch_activegp.physics.joint import JointEffect, driven
from torch_activegp.physics.place import Place
from torch_activegp.physics.stops import JointStop, LowerJointStop

_SMALL = 0.05


class ConstantForce(JointEffect):
    """A force that does not depend on anything: a cable, a counterweight, an offset of a drive."""

    name = "constant_force"
    law = "F"
    needs_steps = False

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        scale = _SMALL * place.force
        parameter = Parameter("force", place.force_unit, scale)
        return cls.make(place, (parameter,), [[scale]], tunable=driven(place, model))

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return values[0] + 0.0 * position

    def steady(self, force: Array, rows: Index, values: Array) -> None:
        """Adds the force."""
        force[rows, self.dof] += values[:, 0]

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes a passive DC motor with a cogging of no periods: a constant torque."""
        self.add_passive(spec, cogging=[float(values[0]), 0.0, 0.5 * np.pi])
        return True


@dataclasses.dataclass(frozen=True, eq=False)
class Spring(JointEffect):
    """Base of the springs, which MuJoCo's own joints have: no force that is held over a time step is as good.

    Args:
        at_joint: the joint's id in the model.
        rest: where the model's own spring rests, rad or m.
    """

    at_joint: int = 0
    rest: float = 0.0

    @property
    def needs_steps(self) -> bool:
        """MuJoCo's own spring needs none."""
        return False

    @classmethod
    def around(cls, place: Place, model: mujoco.MjModel, parameters: tuple[Parameter, ...], **options: Any) -> Self:
        """Makes the spring for a joint; its first seed is soft and rests at zero."""
        seed = [parameters[0].scale, *(0.0 for _ in parameters[1:])]
        joint, rest = int(model.dof_jntid[place.index]), float(model.qpos_spring[place.qpos])
        return cls.make(place, parameters, [seed], at_joint=joint, rest=rest, **options)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``jnt_stiffness``, around the rest of the model's own spring."""
        field("jnt_stiffness")[rows, self.at_joint] += values[:, 0]
        return False

    def steady(self, force: Array, rows: Index, values: Array) -> None:
        """Adds what moves the rest of the spring."""
        force[rows, self.dof] += self.force(np.full(len(rows), self.rest), np.zeros(len(rows)), values.T)


class LinearSpring(Spring):
    """-k (q - q0): MJCF's ``joint stiffness`` and ``springref``. The amplitudes are k and k q0."""

    name = "linear_spring"
    law = "-k (q - q0)"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        scale = _SMALL * place.force / _reach(place)
        parameters = (
            Parameter("stiffness", f"{place.force_unit}/{place.position_unit}", scale, low=_softest(place, model)),
            Parameter("preload", place.force_unit, _SMALL * place.force),
        )
        return cls.around(place, model, parameters, linear=2, variant="rest", tunable=_has_one(place, model))

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return values[1] - values[0] * position

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes stiffness and rest position."""
        return _write_spring(self, spec, float(values[0]), float(values[1]))

    def describe(self, values: Array) -> dict[str, float]:
        """Stiffness and rest position."""
        return {"stiffness": float(values[0]), "rest": float(values[1] / values[0]) if values[0] else 0.0}


class CenteredSpring(Spring):
    """-k q: a spring at rest where the model's coordinate is zero."""

    name = "linear_spring"
    law = "-k q"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        scale = _SMALL * place.force / _reach(place)
        unit = f"{place.force_unit}/{place.position_unit}"
        parameter = Parameter("stiffness", unit, scale, low=_softest(place, model))
        return cls.around(place, model, (parameter,), tunable=_has_one(place, model))

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return -values[0] * position

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes stiffness and rest position."""
        return _write_spring(self, spec, float(values[0]), 0.0)


class CubicSpring(Spring):
    """-k q^3: MJCF's ``joint stiffness``, third coefficient."""

    name = "cubic_spring"
    law = "-k q^3"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        scale = _SMALL * place.force / _reach(place) ** 3
        unit = f"{place.force_unit}/{place.position_unit}3"
        low = -float(model.jnt_stiffnesspoly[model.dof_jntid[place.index], 1])
        return cls.around(place, model, (Parameter("stiffness", unit, scale, low=low),))

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return -values[0] * position**3

    @property
    def needs_steps(self) -> bool:
        """Only where the model's own spring does not rest at zero."""
        return self.rest != 0.0

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``jnt_stiffnesspoly``."""
        if not self.needs_steps:
            field("jnt_stiffnesspoly")[rows, self.at_joint, 1] += values[:, 0]
        return False

    def steady(self, force: Array, rows: Index, values: Array) -> None:
        """Adds nothing."""

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes the third coefficient of the stiffness, where the model's spring rests at zero."""
        joint = self.joint(spec)
        if joint.springref != 0.0 or any(joint.springdamper):
            return False
        joint.stiffness[2] += float(values[0])
        return True


def _reach(place: Place) -> float:
    """The largest recorded distance from the model's zero, rad or m."""
    return max(abs(place.position[0]), abs(place.position[1]), 1e-6)


def _has_one(place: Place, model: mujoco.MjModel) -> bool:
    """Whether the model has a spring there, of which a modeller would have tuned the stiffness."""
    return bool(model.jnt_stiffness[model.dof_jntid[place.index]] > 0.0)


def _softest(place: Place, model: mujoco.MjModel) -> float:
    """The change of stiffness that takes the model's own spring away."""
    return -float(model.jnt_stiffness[model.dof_jntid[place.index]])


def _write_spring(effect: JointEffect, spec: mujoco.MjSpec, stiffness: float, preload: float) -> bool:
    """Adds a spring to what the model has there, unless that is not linear."""
    joint = effect.joint(spec)
    total = joint.stiffness[0] + stiffness
    if any(joint.stiffness[1:]) or any(joint.springdamper) or total <= 0.0:
        return False
    unit = effect.angle(spec, 1.0)
    rest = (joint.stiffness[0] * joint.springref / unit + preload) / total
    joint.stiffness[0], joint.springref = total, rest * unit
    return True


POSITION_FORCES: tuple[type[Effect], ...] = (
    ConstantForce,
    CenteredSpring,
    LinearSpring,
    CubicSpring,
    Cogging,
    JointStop,
    LowerJointStop,
)
"""The family, in the order in which a modeller would try them."""
