"""An effect that acts on one joint's degree of freedom."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Array, Effect, Index, Parameter, Step, element
from torch_activegp.physics.place import Place

WITH_ITS_INERTIA = 7
"""Order of what is written for the inertia that the joint has by then, after all that changes it."""
_ON_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))


@dataclasses.dataclass(frozen=True, eq=False)
class JointEffect(Effect):
    """Base of the effects on a hinge or a slide.

    Args:
        dof: degree of freedom in the model.
        qpos: address of the position.
        nominal_loss: the model's own ``frictionloss`` there, for effects that replace it.
    """

    dof: int = 0
    qpos: int = 0
    nominal_loss: float = 0.0

    @property
    def needs_steps(self) -> bool:
        """Forces act in every step; those that the model's own fields hold say otherwise."""
        return True

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law as a generalised force on the joint, N m or N.

        Args:
            position: rad or m, any shape.
            velocity: rad/s or m/s, same shape.
            values: the P parameters, each a number or an array that broadcasts.
        """
        raise NotImplementedError

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Adds the force at the start of each time step, or where the joint is in its middle."""
        position = step.position(rows, self.qpos, self.dof)
        step.force[rows, self.dof] += self.force(position, step.qvel[rows, self.dof], values.T)

    @classmethod
    def make(
        cls, place: Place, parameters: tuple[Parameter, ...], seeds: Sequence[Sequence[float]], **options: Any
    ) -> Self:
        """Makes the effect for a place."""
        return cls(
            place.target,
            parameters,
            np.array(seeds, dtype=float),
            dof=place.index,
            qpos=place.qpos,
            nominal_loss=place.loss,
            **options,
        )

    def joint(self, spec: mujoco.MjSpec) -> mujoco.MjsJoint:
        """The joint in a model that is being edited."""
        joint: mujoco.MjsJoint = element(spec, spec.joints, self.target)
        return joint

    def angle(self, spec: mujoco.MjSpec, value: float) -> float:
        """A position of the joint, rad or m, in the unit that the model is written in."""
        turns = self.joint(spec).type == mujoco.mjtJoint.mjJNT_HINGE
        return float(np.rad2deg(value)) if turns and spec.compiler.degree else float(value)

    def add_passive(self, spec: mujoco.MjSpec, **laws: Sequence[float]) -> None:
        """Adds an actuator without input to the joint: MuJoCo's DC motor with some of its losses alone."""
        name = self.item
        taken = {actuator.name for actuator in spec.actuators}
        wanted = (f"{name}_{self.name}", *(f"{name}_{self.name}_{i}" for i in range(len(taken))))
        joint = self.joint(spec)
        joint.name = joint.name or name
        actuator = spec.add_actuator(
            name=next(free for free in wanted if free not in taken),
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            target=joint.name,
        )
        no_input = int(mujoco.mjtCtrlInput.mjINPUT_NONE)
        actuator.set_to_dcmotor(motorconst=[0.0, 0.0], resistance=1.0, ctrlspec=no_input, **laws)


def drivers(place: Place, model: mujoco.MjModel) -> Index:
    """The actuators on a joint that have an input."""
    direct = np.isin(model.actuator_trntype, _ON_JOINTS) & (model.actuator_ctrlnum > 0)
    return np.flatnonzero(direct & (model.actuator_trnid[:, 0] == model.dof_jntid[place.index]))


def driven(place: Place, model: mujoco.MjModel) -> bool:
    """Whether an actuator moves a joint: one on it, or one that may move several, by a tendon for instance."""
    elsewhere = ~np.isin(model.actuator_trntype, _ON_JOINTS) & (model.actuator_ctrlnum > 0)
    return bool(elsewhere.any() or drivers(place, model).size)
