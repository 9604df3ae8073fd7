"""Two names of a set that say what one can say."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.runs import Array
from torch_activegp.physics.actuation import ActuatorBias
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.inertia import CenterOfMassOffset, GravityError
from torch_activegp.physics.payload import PayloadAside, PayloadMass
from torch_activegp.physics.springs import CenteredSpring, LinearSpring

Pair = tuple[Effect, Array]

TWO_SIDED = "asymmetric_friction"


def merged(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """A set with one name in place of two, wherever one can hold both.

    Args:
        pairs: effects and their parameters.
        effects: what is tried.
    """
    return [*_two_levels(pairs, effects), *_loads_elsewhere(pairs, effects), *_springs_at_rest(pairs, effects)]


def _two_levels(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """An asymmetric friction in place of a symmetric one and something constant.

    Where the constant is the larger one, that is no friction in one direction, and they stay two.
    """
    out: list[list[Pair]] = []
    for dry, level in pairs:
        laws = [e for e in effects if e.target == dry.target and dry.name in e.covers and e.name == TWO_SIDED]
        for constant, value in pairs if dry.name == "coulomb_friction" else ():
            gravity = constant if isinstance(constant, GravityError) else None
            force = gravity.push(value, dry.target) if gravity else push(constant, value, dry.target)
            two_sided = np.array([level[0] - force, level[0] + force])
            others = [(e, v) for e, v in pairs if e is not dry and e is not constant]
            out += [[*others, (law, two_sided)] for law in laws if force and law.plausible(two_sided)]
    return out


def _springs_at_rest(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """A spring that rests elsewhere in place of one at the model's zero and something constant."""
    out: list[list[Pair]] = []
    for spring, stiffness in pairs:
        forms = [e for e in effects if isinstance(spring, CenteredSpring) and e.key == spring.key]
        for constant, value in pairs if forms else ():
            force = push(constant, value, spring.target)
            others = [(e, v) for e, v in pairs if e is not spring and e is not constant]
            resting = [form for form in forms if isinstance(form, LinearSpring)]
            out += [[*others, (form, np.array([stiffness[0], force]))] for form in resting if force]
    return out


def pushes_alone(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """A constant force, or a drive's bias, in place of a spring: one that hardly stiffens is a push from far away."""
    out: list[list[Pair]] = []
    for spring, value in pairs:
        if isinstance(spring, LinearSpring):
            others = [(e, v) for e, v in pairs if e is not spring]
            units = [(e, push(e, np.ones(1), spring.target)) for e in effects if all(e.key != o.key for o, _ in others)]
            out += [[*others, (e, np.array([value[1] / unit]))] for e, unit in units if unit]
    return out


def push(effect: Effect, value: Array, target: str) -> float:
    """The constant force of an effect on a joint, N m or N."""
    if effect.key == ("constant_force", target):
        return float(value[0])
    if isinstance(effect, ActuatorBias) and effect.drives == target:
        return float(value[0]) * effect.nominal_gain * effect.gear
    return 0.0


def _loads_elsewhere(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """A load at another place instead of a load and another centre of mass of the body that carries it."""
    out: list[list[Pair]] = []
    for load, mass in pairs:
        forms = [form for form in effects if form.key == load.key and isinstance(form, PayloadAside)]
        for shift, by in pairs if load.name == "payload_mass" and mass[0] > 0.0 else ():
            if not isinstance(shift, CenterOfMassOffset) or shift.target != load.target:
                continue
            moved = np.zeros(3)
            moved[list(shift.axes)] = by
            there = load.offsets(mass[None])[0] if isinstance(load, PayloadMass) else np.zeros(3)
            others = [(e, v) for e, v in pairs if e is not load and e is not shift]
            fitting = [form for form in forms if set(shift.axes) <= set(form.axes)]
            out += [[*others, (form, form.moving(float(mass[0]), there, moved))] for form in fitting]
    return out
