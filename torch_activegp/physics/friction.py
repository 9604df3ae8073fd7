"""Dry friction on a joint, and the whole family."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.drag import AsymmetricFriction, QuadraticDrag, ViscousFriction
from torch_activegp.physics.effect import Acting, Array, Effect, Index, Parameter, Step
from torch_activegp.physics.joint import WITH_ITS_INERTIA, JointEffect
from torch_activegp.physics.place import Place

_SMALL = 0.05
SHARP = 2.0
"""Time constant of MuJoCo's friction constraint in time steps: its default of 20 ms lets a stuck joint creep."""
IMPEDANCE = (0.99, 0.999)
_BRISTLES = 0.5
_A_LITTLE = 0.15
"""Share of the first-order friction with which a fit also starts."""
_USUAL_SPEED = 0.1
"""Stribeck velocity, in parts of the top speed."""
_STEEPEST = 19.0
"""Static friction beyond what slides, over what slides, at most; machines show 0.1 to 2, and more where they slide
nearly without friction. Static friction alone is no friction."""


def sharpen(field: Callable[[str], Array], rows: Index, dof: int) -> None:
    """Makes dry friction stick firmly in some simulations, as :func:`write_sharp` does in a model."""
    field("dof_solref")[rows, dof, 0] = SHARP * field("opt.timestep")[rows]
    field("dof_solref")[rows, dof, 1] = 1.0
    field("dof_solimp")[rows, dof, :2] = IMPEDANCE


def write_sharp(joint: mujoco.MjsJoint, timestep: float) -> None:
    """Writes ``solreffriction`` and ``solimpfriction`` for dry friction that sticks firmly."""
    joint.solref_friction = np.array([SHARP * timestep, 1.0])
    joint.solimp_friction = np.array([*IMPEDANCE, *joint.solimp_friction[2:]])


def sticking(model: mujoco.MjModel, step: float) -> mujoco.MjModel:
    """A copy of a model whose own dry friction sticks firmly, in time steps of some length, s."""
    firm, rubbing = copy.copy(model), model.dof_frictionloss > 0.0
    firm.dof_solref[rubbing] = (SHARP * step, 1.0)
    firm.dof_solimp[rubbing, :2] = IMPEDANCE
    return firm


class DryFriction(JointEffect):
    """Base of the frictions that can hold a joint: too much of it does, and no derivative shows the way back."""

    def starts_beside(self, values: Array) -> list[Array]:
        """The same with a little of it."""
        return [np.where(np.arange(len(values)) < self.linear, _A_LITTLE, 1.0) * values]


class CoulombFriction(DryFriction):
    """-F sign(v), with sticking: MJCF's ``joint frictionloss``."""

    name = "coulomb_friction"
    law = "-F sign(v), with sticking"
    losses = frozenset({"level"})
    needs_steps = False

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint; of one that the model has there a modeller would have tuned the level."""
        scale, own = _SMALL * place.force, float(model.dof_frictionloss[place.index])
        parameter = Parameter("level", place.force_unit, scale, low=-own)
        return cls.make(place, (parameter,), [[scale]], tunable=own > 0.0)

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return -values[0] * np.sign(velocity)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds to ``dof_frictionloss``, and makes it stick firmly."""
        self.add_loss(field, rows, values)
        sharpen(field, rows, self.dof)
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint frictionloss``, and solver parameters with which it sticks firmly."""
        self.write_loss(spec, values)
        write_sharp(self.joint(spec), spec.option.timestep)
        return True

    def add_loss(self, field: Callable[[str], Array], rows: Index, values: Array) -> None:
        """Adds to ``dof_frictionloss`` in some simulations."""
        loss = field("dof_frictionloss")
        loss[rows, self.dof] = np.maximum(loss[rows, self.dof] + values[:, 0], 0.0)

    def write_loss(self, spec: mujoco.MjSpec, values: Array) -> None:
        """Writes ``joint frictionloss``."""
        joint = self.joint(spec)
        joint.frictionloss = max(joint.frictionloss + float(values[0]), 0.0)


class StribeckFriction(DryFriction):
    """-(F + (S - F) exp(-(v / w)^2)) sign(v), sticking: Coulomb friction, and a static excess that falls with speed.

    The amplitudes are the Coulomb level F and the excess S - F; w is the Stribeck velocity.
    """

    name = "stribeck_friction"
    never_negative = frozenset({"static", "velocity"})
    law = "-(F + (S - F) exp(-(v/w)^2)) sign(v), with sticking"
    losses = frozenset({"coulomb", "static"})
    covers = ("coulomb_friction",)
    order = WITH_ITS_INERTIA

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint, with Stribeck velocities from 2 to 50 % of the top speed."""
        scale, nominal = _SMALL * place.force, float(model.dof_frictionloss[place.index])
        top = place.top_speed
        parameters = (
            Parameter("coulomb", place.force_unit, scale, low=-nominal),
            Parameter("excess", place.force_unit, scale, low=0.0),
            Parameter("velocity", f"{place.position_unit}/s", _USUAL_SPEED * top, low=0.005 * top, high=0.7 * top),
        )
        return cls.make(place, parameters, [[scale, scale, share * top] for share in (0.03, 0.08, 0.2, 0.45)], linear=2)

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return -self.added(velocity, values) * np.sign(velocity)

    @staticmethod
    def added(velocity: Array | float, values: Sequence[Array] | Array) -> Array:
        """What it adds to the model's own dry friction: F, and of the static excess S - F what is left at some speed.

        Args:
            velocity: of the joint.
            values: F, S - F and w, along the first axis.
        """
        return np.asarray(values[0] + values[1] * np.exp(-((velocity / values[2]) ** 2)))

    def usual(self, level: float) -> list[Array]:
        """Parameters with half of a level as static excess, at Stribeck velocities of 1 and 3 % of the top speed.

        Machines have 0.1 to 2 of it. Where either shows nothing in recordings, these do not tell.
        """
        top = self.parameters[2].scale / _USUAL_SPEED
        return [np.array([level, 0.5 * (self.nominal_loss + level), share * top]) for share in (0.01, 0.03)]

    def plausible(self, values: Array) -> bool:
        """Whether there is friction at speed too."""
        return bool(values[1] <= _STEEPEST * (self.nominal_loss + values[0]))

    def acts(self, values: Array) -> Acting:
        """Where the static excess has not fallen to a tenth: there it is no Coulomb friction."""
        width = float(values[2]) * np.sqrt(np.log(10.0))
        return Acting(self.item, f"qvel.{self.item}", ((-width, width),))

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Makes the friction stick firmly."""
        sharpen(field, rows, self.dof)
        return False

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Sets ``dof_frictionloss`` by the speed at the start of the step."""
        level = self.added(step.qvel[rows, self.dof], values.T)
        step.field("dof_frictionloss")[rows, self.dof] = np.maximum(self.nominal_loss + level, 0.0)

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes a passive DC motor with LuGre friction, whose bristles are as stiff as the time step allows.

        Sliding, it agrees with the law to a few percent at steps of 2 ms, better at shorter ones.
        """
        inertia = 1.0 / float(spec.copy().compile().dof_invweight0[self.dof])
        joint = self.joint(spec)
        level = joint.frictionloss + float(values[0])
        if level <= 0.0:
            return False
        joint.frictionloss = 0.0
        bristles = _BRISTLES * inertia / spec.option.timestep**2
        self.add_passive(spec, lugre=[bristles, 0.0, level, level + float(values[1]), float(values[2])])
        return True

    def describe(self, values: Array) -> dict[str, float]:
        """Coulomb level, static level and Stribeck velocity."""
        return {"coulomb": float(values[0]), "static": float(values[0] + values[1]), "velocity": float(values[2])}


class AsymmetricCoulomb(DryFriction):
    """-F+ for v > 0 and +F- for v < 0, with sticking: dry friction that depends on the direction.

    The same as Coulomb friction of the mean of both, and a constant force of half the difference.
    """

    name = "asymmetric_friction"
    law = "-F+ for v > 0, +F- for v < 0, with sticking"
    losses = frozenset({"positive_level", "negative_level"})
    needs_steps = False
    covers = ("coulomb_friction",)

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether the joint goes both ways; what goes one way shows one level."""
        return place.both_ways

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for a joint."""
        scale, low = _SMALL * place.force, -float(model.dof_frictionloss[place.index])
        parameters = (
            Parameter("positive_level", place.force_unit, scale, low=low),
            Parameter("negative_level", place.force_unit, scale, low=low),
        )
        return cls.make(place, parameters, [[scale, scale]], linear=2, variant="coulomb")

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return -np.where(velocity > 0, values[0], values[1]) * np.sign(velocity)

    def plausible(self, values: Array) -> bool:
        """Whether the friction brakes in both directions."""
        return bool((self.nominal_loss + values >= 0.0).all())

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Adds the mean of both to ``dof_frictionloss``."""
        loss = field("dof_frictionloss")
        loss[rows, self.dof] = np.maximum(loss[rows, self.dof] + values.mean(axis=1), 0.0)
        sharpen(field, rows, self.dof)
        return False

    def steady(self, force: Array, rows: Index, values: Array) -> None:
        """Adds half the difference as a constant force."""
        force[rows, self.dof] -= 0.5 * (values[:, 0] - values[:, 1])

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint frictionloss`` and a passive DC motor for the constant force."""
        joint = self.joint(spec)
        joint.frictionloss = max(joint.frictionloss + float(values.mean()), 0.0)
        write_sharp(joint, spec.option.timestep)
        self.add_passive(spec, cogging=[0.5 * float(values[1] - values[0]), 0.0, 0.5 * np.pi])
        return True


FRICTION: tuple[type[Effect], ...] = (
    ViscousFriction,
    CoulombFriction,
    QuadraticDrag,
    AsymmetricFriction,
    AsymmetricCoulomb,
    StribeckFriction,
)
"""The family, in the order in which a modeller would try them."""
