"""A force that is held over each time step, as simulators have it whose authors add one before they step."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self

import numpy as np

from torch_activegp.physics.effect import Array, Effect, Index, Step
from torch_activegp.physics.friction import DryFriction
from torch_activegp.physics.joint import JointEffect

_BESIDE = 1e-3
"""Part of a motion by which it is changed to see how a force changes."""
_LEAST = 1e-12
"""And the least, of what does not move."""


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class HeldForce(JointEffect):
    """The law of another effect, of the state that a time step begins with, held over the step.

    Args:
        of: the effect.
    """

    of: JointEffect

    name = "held_force"
    law = "that of another effect, as it is when a time step begins"

    @classmethod
    def like(cls, effect: Effect) -> Self | None:
        """An effect so, where it is a force of position and speed alone that neither strikes nor sticks; else None."""
        if not isinstance(effect, JointEffect) or effect.strikes or isinstance(effect, DryFriction):
            return None
        own = type(effect)
        if own.memory is not Effect.memory or own.force is JointEffect.force:
            return None
        return cls(**{f.name: getattr(effect, f.name) for f in dataclasses.fields(JointEffect)}, of=effect)

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        return self.of.force(position, velocity, values)

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Adds the force at the start of each time step."""
        position, velocity = step.qpos[rows, self.qpos], step.qvel[rows, self.dof]
        step.force[rows, self.dof] += self.force(position, velocity, values.T)

    def slopes(self, position: Array, velocity: Array, values: Array) -> Array:
        """How the force changes with velocity and with position, ``(2,)``, each in the root mean square over a motion.

        Args:
            position: ``(N,)``, rad or m.
            velocity: ``(N,)``, rad/s or m/s.
            values: the parameters, ``(P,)``.
        """
        v, q = (max(_BESIDE * float(motion.std()), _LEAST) for motion in (velocity, position))
        faster = self.force(position, velocity + v, values) - self.force(position, velocity - v, values)
        farther = self.force(position + q, velocity, values) - self.force(position - q, velocity, values)
        return np.sqrt([np.mean((faster / (2.0 * v)) ** 2), np.mean((farther / (2.0 * q)) ** 2)])
