"""Soft stops: a joint meets something past a position."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import ClassVar, Self

import mujoco
import numpy as np

from torch_activegp.physics.effect import Acting, Array, Parameter
from torch_activegp.physics.joint import WITH_ITS_INERTIA, JointEffect
from torch_activegp.physics.place import Place

_STOP_PLACES, _HARDEST = 12, 0.0024
"""From so little of the recorded range: a hard stop that was struck twice gave way by 1 mm of 1 m."""
_DEEPEST = 0.6
"""Part of the range behind a stop at most. On a drive that was always behind one (EMPS), its damper was what a viscous
friction has more of in one direction."""
_BEYOND = 0.05
"""Part of the range beyond it at which a stop may be: an encoder that reads a little less than there is shows the joint
short of its stop. One that read 1 % less kept a stop 18 mrad from where it was, and three effects were `unknown`."""
_APART = 0.03
"""Part of the range by which a stop lies before where the model touches something itself: one in the same place makes
its contact harder. Where nothing was missing, one stood for time steps of 1 ms at the impacts of a sphere."""
_SOFT, _BOUNCES = 0.1, 0.2
"""Part of a hard stop's stiffness from which on another stop is hard itself; damping of a hard one, of half the
critical."""
_STICKIEST = 10.0
"""Times the critical damping that a stop may have: one that does not spring back is a damping of a part of the way. On
a drive with other friction one way than the other (EMPS), a stop without any stiffness stood for that."""
_EARLIER = (1.0, 2.0)
"""How much further in a stop is sought, in hundredths of the range, which is the scale of its place."""
_HARDNESSES = (0.2, 5.0, 25.0, 125.0)
"""Times as stiff as it was found, for how hard a stop may be."""
_IMPEDANCE = 1e-4
_FAR = 1e4


@dataclasses.dataclass(frozen=True, eq=False)
class JointStop(JointEffect):
    """A one-sided spring and damper past a position: max(0, k p + d v) against the penetration p.

    Args:
        inertia: of the joint in the nominal model, kg m2 or kg.
        speed: of the joint where it is fast, rad/s or m/s.
        end: of the recorded range, or a little before where the model touches something there, rad or m.
    """

    name = "joint_stop"
    never_negative = frozenset({"stiffness", "damping"})
    law = "-max(0, k p + d v) past the stop, p the penetration"
    order = WITH_ITS_INERTIA
    strikes = True
    inertia: float = 1.0
    speed: float = 0.0
    end: float = 0.0
    side: ClassVar[float] = 1.0

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        """Makes the effect for the upper end of the range."""
        low, high = place.position if cls.side > 0 else (-place.position[1], -place.position[0])
        width = max(high - low, 1e-9)
        lowest, last = high - _DEEPEST * width, high + _BEYOND * width
        touches = max(cls.side * end for end in place.free) - _APART * width
        if lowest < touches < high:
            high = last = touches
        stiffness = 10 * place.force / width
        parameters = (
            Parameter("stiffness", f"{place.force_unit}/{place.position_unit}", stiffness, low=0.0),
            Parameter(
                "damping", f"{place.force_unit} s/{place.position_unit}", 0.2 * place.force / place.speed, low=0.0
            ),
            Parameter(
                "position",
                place.position_unit,
                0.01 * width,
                low=lowest,
                high=last,
                place=True,
            ),
        )
        places = high - np.geomspace(_HARDEST * width, min(0.45 * width, 0.75 * (high - lowest)), _STOP_PLACES)
        seeds = [[stiffness, 0.1 * place.force / place.speed, position] for position in places]
        inertia = 1.0 / max(float(model.dof_invweight0[place.index]), 1e-12)
        way = {"variant": "upper" if cls.side > 0 else "lower", "inertia": inertia, "speed": place.speed, "end": high}
        return cls.make(place, parameters, seeds, linear=2, **way)

    def starts_beside(self, values: Array) -> list[Array]:
        """The same stiffness with half the critical damping, and all of it: a hard stop takes the bounce away.

        And one so hard that it ends the joint's motion on the way that is left: of a stop that is struck once, the
        first order says nothing.
        """
        half = np.sqrt(np.maximum(values[0], 0.0) * self.inertia)
        beside = [np.array([values[0], damping, values[2]]) for damping in (half, 2.0 * half) if half > 0.0]
        depth = self._depth(values)
        hard = self.inertia * (self.speed / depth) ** 2
        if hard * _SOFT <= values[0]:
            return beside
        return [*beside, np.array([hard, _BOUNCES * np.sqrt(hard * self.inertia), values[2]])]

    def _depth(self, values: Array) -> float:
        """How deep the motion's end is past the stop, rad or m; a little where it does not reach it."""
        return max(float(self.end - values[2]), self.parameters[2].scale * _HARDEST)

    def further_in(self, values: Array) -> list[Array]:
        """Earlier on the way, with the same force at its end, and as much of the critical damping.

        None where it does not push back.
        """
        place = self.parameters[2]
        depth, out = max(float(self.end - values[2]), place.scale), list[Array]()
        for deeper in depth + place.scale * np.array(_EARLIER) if values[0] > 0.0 else ():
            softer, stop = depth / deeper, self.end - deeper
            if stop > place.low:
                out.append(np.array([softer * values[0], np.sqrt(softer) * values[1], stop]))
        return out

    def as_hard(self, values: Array) -> list[Array]:
        """Softer or harder, with the motion's end where it is, and as much of the critical damping."""
        depth = self._depth(values)
        beside = ([f * values[0], np.sqrt(f) * values[1], self.end - depth / np.sqrt(f)] for f in _HARDNESSES)
        return [np.array(one) for one in beside if one[2] > self.parameters[2].low]

    def force(self, position: Array, velocity: Array, values: Sequence[Array] | Array) -> Array:
        """The law; see :meth:`JointEffect.force`."""
        depth = self.side * position - values[2]
        push = values[0] * depth + values[1] * self.side * velocity
        return np.where(depth > 0, -self.side * np.maximum(push, 0.0), 0.0)

    def plausible(self, values: Array) -> bool:
        """Whether it springs back."""
        return bool(values[1] <= _STICKIEST * 2.0 * np.sqrt(max(values[0], 0.0) * self.inertia))

    def write(self, spec: mujoco.MjSpec, values: Array) -> bool:
        """Writes ``joint range`` with ``solreflimit`` and ``solimplimit``, where the joint has no limits yet.

        At the least impedance d, MuJoCo's constraint is a spring and a damper of its ``solref`` over the joint's
        inertia as the solver sees it.
        """
        joint = self.joint(spec)
        free = joint.limited == mujoco.mjtLimited.mjLIMITED_FALSE or joint.range[0] >= joint.range[1]
        softness = float(spec.copy().compile().dof_invweight0[self.dof]) * (1.0 - _IMPEDANCE)
        wanted = -softness * np.maximum(values[:2], 1e-12)
        if not free and not np.allclose(joint.solref_limit, wanted, rtol=1e-3):
            return False
        far = self.angle(spec, _FAR)
        low, high = (-far, far) if free else joint.range
        stop = self.angle(spec, float(self.side * values[2]))
        joint.range = np.array([low, min(stop, high)] if self.side > 0 else [max(stop, low), high])
        joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
        joint.solref_limit = wanted
        joint.solimp_limit = np.array([_IMPEDANCE, _IMPEDANCE, *joint.solimp_limit[2:]])
        return True

    def acts(self, values: Array) -> Acting:
        """Past the stop."""
        stop = float(self.side * values[2])
        return Acting(self.item, f"qpos.{self.item}", ((stop, np.inf) if self.side > 0 else (-np.inf, stop),))

    def describe(self, values: Array) -> dict[str, float]:
        """Position, stiffness and damping."""
        return {"position": float(self.side * values[2]), "stiffness": float(values[0]), "damping": float(values[1])}


class LowerJointStop(JointStop):
    """The same at the lower end of the range."""

    side: ClassVar[float] = -1.0
