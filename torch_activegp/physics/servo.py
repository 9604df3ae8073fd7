"""Drives whose force depends on the motion, such as position servos: all of it may be weaker, or end at a limit."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.actuation import ActuatorGain, ActuatorSaturation, narrower
from torch_activegp.physics.effect import Array, Effect, Index, Parameter, element
from torch_activegp.physics.place import Place

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
        joint: name of the joint.
    """

    actuator: int
    index: int
    dof: int
    qpos: int
    gear: float
    gain: float
    bias: tuple[float, float, float]
    joint: str

    @classmethod
    def of(cls, model: mujoco.MjModel, actuator: int) -> Self | None:
        """The law of an actuator; None where it has another one, or its force does not depend on the motion."""
        plain = (
            model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_JOINT
            and model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_NONE
            and model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
            and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE
            and model.actuator_ctrlnum[actuator] == 1
        )
        bias, gain = model.actuator_biasprm[actuator, :3], float(model.actuator_gainprm[actuator, 0])
        joint = int(model.actuator_trnid[actuator, 0])
        if not (plain and gain and bias[1:].any() and int(model.jnt_type[joint]) in _ONE_WAY):
            return None
        return cls(
            actuator,
            int(model.actuator_ctrladr[actuator]),
            int(model.jnt_dofadr[joint]),
            int(model.jnt_qposadr[joint]),
            float(model.actuator_gear[actuator, 0]),
            gain,
            (float(bias[0]), float(bias[1]), float(bias[2])),
            model.joint(joint).name or f"joint{joint}",
        )

    def force(self, position: Array, velocity: Array, control: Array) -> Array:
        """Of the drive, at the joint's position, rad or m, its velocity, rad/s or m/s, and a control; N m or N."""
        constant, stiffness, damping = self.bias
        along = self.gear * (stiffness * position + damping * velocity)
        return np.asarray(self.gain * control + constant + along)


@dataclasses.dataclass(frozen=True, eq=False)
class ServoEffect(Effect):
    """Base of the effects on the force of a servo, its feedback included.

    Args:
        servo: its law.
    """

    servo: ServoLaw | None = None

    @classmethod
    def fits(cls, place: Place, model: mujoco.MjModel) -> bool:
        """Whether the drive is a servo that moves a recorded joint."""
        return place.servo_force > 0.0 and ServoLaw.of(model, _actuator_at(place, model)) is not None

    @classmethod
    def make(cls, place: Place, model: mujoco.MjModel, parameter: Parameter, seeds: Sequence[float]) -> Self:
        """Makes the effect for an actuator."""
        servo = ServoLaw.of(model, _actuator_at(place, model))
        return cls(place.target, (parameter,), np.array(seeds)[:, None], linear=0, variant="force", servo=servo)

    @property
    def law_of_it(self) -> ServoLaw:
        """The servo's law."""
        assert self.servo is not None
        return self.servo

    @property
    def drives(self) -> str:
        """The joint that it acts on."""
        return f"joint:{self.law_of_it.joint}"

    def change(self, position: Array, velocity: Array, control: Array, values: Array) -> Array:
        """What is added to its force along a motion, in units of its control; arguments as :meth:`ServoLaw.force`."""
        raise NotImplementedError


class ServoSaturation(ServoEffect):
    """clip(f, -limit, limit) of a servo's force f, its feedback included; `ActuatorSaturation` limits its command."""

    name = "actuator_saturation"
    never_negative = frozenset({"limit"})
    law = "clip(f, -limit, limit) of the servo's force f"
    order = ActuatorSaturation.order

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator, sized by the force that it gives in the recordings."""
        top = place.servo_force
        joint = model.actuator_trnid[_actuator_at(place, model), 0]
        unit = "N" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "N m"
        parameter = Parameter("limit", unit, 0.03 * top, low=0.02 * top, high=top, place=True)
        return cls.make(place, model, parameter, [top * share for share in _SEEDS])

    def change(self, position: Array, velocity: Array, control: Array, values: Array) -> Array:
        """What it loses."""
        force = self.law_of_it.force(position, velocity, control)
        return np.asarray((np.clip(force, -values[0], values[0]) - force) / self.law_of_it.gain)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Narrows ``actuator_forcerange``."""
        limited, ends, at = field("actuator_forcelimited"), field("actuator_forcerange"), self.law_of_it.actuator
        was = limited[rows, at].astype(bool)[:, None]
        low, high = np.where(was, ends[rows, at], np.array([-np.inf, np.inf])).T
        ends[rows, at] = np.stack([np.maximum(low, -values[:, 0]), np.minimum(high, values[:, 0])], axis=1)
        limited[rows, at] = True
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``forcerange``."""
        actuator, limit = element(spec, spec.actuators, self.target), float(values[0])
        actuator.forcerange = narrower(actuator.forcerange, limit)
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        return True


class ServoGain(ServoEffect):
    """(1 + c) f: all of a servo's force f is stronger or weaker; `ActuatorGain` scales its command alone."""

    name = "actuator_gain"
    law = "g f of the servo's force f"
    order = ActuatorGain.order

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for an actuator."""
        made = cls.make(place, model, Parameter("excess", "1", 0.05, low=-0.95, high=9.0), [0.05])
        return dataclasses.replace(made, linear=1, tunable=True)

    def change(self, position: Array, velocity: Array, control: Array, values: Array) -> Array:
        """What it gains."""
        return np.asarray(values[0] * self.law_of_it.force(position, velocity, control) / self.law_of_it.gain)

    def edit(self, field: Callable[[str], Array], rows: Index, values: Array) -> bool:
        """Scales ``actuator_gainprm`` and ``actuator_biasprm``."""
        for name in ("actuator_gainprm", "actuator_biasprm"):
            field(name)[rows, self.law_of_it.actuator, :3] *= 1.0 + values
        return False

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Scales ``gainprm`` and ``biasprm``, but not a damping that is given as a ratio."""
        actuator = element(spec, spec.actuators, self.target)
        if actuator.biasprm[2] > 0.0:
            return False
        actuator.gainprm[0] *= 1.0 + float(values[0])
        actuator.biasprm[:3] *= 1.0 + float(values[0])
        return True

    def describe(self, values: Array) -> dict[str, float]:
        """The gain, 1 for the model's own."""
        return {"gain": 1.0 + float(values[0])}


def _actuator_at(place: Place, model: mujoco.MjModel) -> int:
    """The number of the actuator that a place's control feeds."""
    return int(np.flatnonzero((model.actuator_ctrladr == place.index) & (model.actuator_ctrlnum > 0))[0])


SERVO: tuple[type[ServoEffect], ...] = (ServoGain, ServoSaturation)
"""The family, in the order in which a modeller would try them."""
