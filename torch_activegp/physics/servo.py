"""A drive whose force depends on the motion, such as a position servo, and ends at a limit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.actuation import ActuatorSaturation
from torch_activegp.physics.actuator import fed_by
from torch_activegp.physics.effect import Array, Effect, Index, Parameter, element
from torch_activegp.physics.naming import joint_name
from torch_activegp.physics.place import Place

_JOINTS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))  # the same for a hinge or a slide
_ONE_WAY = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_SEEDS = (0.97, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2)


@dataclasses.dataclass(frozen=True)
class ServoLaw:
    """Force of a drive of one joint: gain u + constant + stiffness l + damping w, l and w its length and speed.

    Args:
        actuator: its number.
        index: which control.
        dof: of the joint.
        qpos: address of the joint's position.
        gear: from the joint's position to the drive's length, and from the drive's force to the joint's.
        gain: force for a control of one.
        bias: constant, stiffness and damping.
        limits: where its force ends, low and high.
        joint: name of the joint.
        unit: of the force.
    """

    actuator: int
    index: int
    dof: int
    qpos: int
    gear: float
    gain: float
    bias: tuple[float, float, float]
    limits: tuple[float, float]
    joint: str
    unit: str

    @classmethod
    def of(cls, model: mujoco.MjModel, actuator: int) -> Self | None:
        """The law of an actuator; None where it has another one, or its force does not depend on the motion."""
        plain = (
            int(model.actuator_trntype[actuator]) in _JOINTS
            and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
            and model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
            and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
            and model.actuator_ctrlnum[actuator] == 1
        )
        bias, gain = model.actuator_biasprm[actuator, :3], float(model.actuator_gainprm[actuator, 0])
        joint = int(model.actuator_trnid[actuator, 0])
        if not (plain and gain and bias[1:].any() and int(model.jnt_type[joint]) in _ONE_WAY):
            return None
        low, high = model.actuator_forcerange[actuator] if model.actuator_forcelimited[actuator] else (-np.inf, np.inf)
        return cls(
            actuator,
            int(model.actuator_ctrladr[actuator]),
            int(model.jnt_dofadr[joint]),
            int(model.jnt_qposadr[joint]),
            float(model.actuator_gear[actuator, 0]),
            gain,
            (float(bias[0]), float(bias[1]), float(bias[2])),
            (float(low), float(high)),
            joint_name(model, joint),
            "N m" if int(model.jnt_type[joint]) == _ONE_WAY[0] else "N",
        )

    def force(self, position: Array, velocity: Array, control: Array) -> Array:
        """Of the drive, at the joint's position, rad or m, its velocity, rad/s or m/s, and a control; N m or N."""
        constant, stiffness, damping = self.bias
        along = self.gear * (stiffness * position + damping * velocity)
        return np.asarray(np.clip(self.gain * control + constant + along, *self.limits))


@dataclasses.dataclass(frozen=True, eq=False)
class ServoSaturation(Effect):
    """clip(f, -limit, limit) of a servo's force f, its feedback included; `ActuatorSaturation` limits its command.

    Args:
        servo: its law in the nominal model.
    """

    servo: ServoLaw = dataclasses.field(kw_only=True)

    name = "actuator_saturation"
    never_negative = frozenset({"limit"})
    law = "clip(f, -limit, limit) of the servo's force f"
    order = ActuatorSaturation.order + 1

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether the drive is a servo that moves a recorded joint."""
        return place.servo_force > 0.0 and ServoLaw.of(model, fed_by(model, place.index)) is not None

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator, sized by the force that it gives in the recordings."""
        top, servo = place.servo_force, ServoLaw.of(model, fed_by(model, place.index))
        assert servo is not None
        parameter = Parameter("limit", servo.unit, 0.03 * top, low=0.02 * top, high=top, place=True)
        seeds = top * np.array(_SEEDS)[:, None]
        return cls(place.target, (parameter,), seeds, linear=0, variant="force", servo=servo)

    @property
    def acts_on(self) -> str:
        """The joint that it drives."""
        return f"joint:{self.servo.joint}"

    def limits(self, values: Array) -> tuple[float, float]:
        """Where the servo's force ends then, low and high, with its own limits; values ``(P,)``."""
        low, high = self.servo.limits
        return max(low, -float(values[0])), min(high, float(values[0]))

    def added(self, position: Array, velocity: Array, control: Array, values: Array) -> Array:
        """What it adds to the joint's force along a motion; arguments as of :meth:`ServoLaw.force`."""
        force = self.servo.force(position, velocity, control)
        return np.asarray(self.servo.gear * (np.clip(force, *self.limits(values)) - force))

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Narrows ``actuator_forcerange``."""
        limited, ends, at = field("actuator_forcelimited"), field("actuator_forcerange"), self.servo.actuator
        low, high = self.servo.limits
        ends[rows, at] = np.stack([np.maximum(low, -values[:, 0]), np.minimum(high, values[:, 0])], axis=1)
        limited[rows, at] = True
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``forcerange``, unless that would be empty."""
        low, high = self.limits(values)
        if low >= high:
            return False
        actuator = element(spec, spec.actuators, self.target)
        actuator.forcerange = np.array([low, high])
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        return True
