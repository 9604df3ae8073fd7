"""Base of the effects on a drive's control, and their order."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Effect, Parameter, element
from torch_activegp.physics.naming import joint_name
from torch_activegp.physics.place import Place


def fed_by(model: mujoco.MjModel, control: int) -> int:
    """The number of the actuator that a control feeds."""
    return int(np.flatnonzero((model.actuator_ctrladr == control) & (model.actuator_ctrlnum > 0))[0])


@dataclasses.dataclass(frozen=True, eq=False)
class ActuatorEffect(Effect):
    """Base of the effects on a control.

    Several on one actuator act in MuJoCo's :attr:`order`: it delays and filters the control before gain, bias and
    limit; what it has not, a dead band, stands between.

    Args:
        index: which control.
        nominal_gain: the model's own factor from control to force.
        nominal: the model's own constant force, and its ``dyntype``.
        drives: the joint that it acts on directly, ``joint:`` and its name, or nothing.
        gear: from its force to the joint's.
    """

    index: int = 0
    nominal_gain: float = 1.0
    nominal: tuple[float, int] = (0.0, int(mujoco.mjtDyn.mjDYN_NONE))
    drives: str = ""
    gear: float = 1.0

    @classmethod
    def make(
        cls, place: Place, model: mujoco.MjModel, parameter: Parameter, seeds: Sequence[float], linear: int = 0
    ) -> Self:
        """Makes the effect for an actuator."""
        actuator = fed_by(model, place.index)
        joint, kind = int(model.actuator_trnid[actuator, 0]), int(model.actuator_trntype[actuator])
        direct = kind in (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
        return cls(
            place.target,
            (parameter,),
            np.array(seeds, dtype=float)[:, None],
            index=place.index,
            nominal_gain=float(model.actuator_gainprm[actuator, 0]),
            nominal=(float(model.actuator_biasprm[actuator, 0]), int(model.actuator_dyntype[actuator])),
            drives=f"joint:{joint_name(model, joint)}" if direct else "",
            gear=float(model.actuator_gear[actuator, 0]),
            linear=linear,
        )

    @property
    def acts_on(self) -> str:
        """The joint that it drives; the actuator itself where it acts through a tendon or on a body."""
        return self.drives or self.target

    def actuator(self, spec: mujoco.MjSpec) -> mujoco.MjsActuator:
        """The actuator in a model that is being edited."""
        actuator: mujoco.MjsActuator = element(spec, spec.actuators, self.target)
        return actuator
