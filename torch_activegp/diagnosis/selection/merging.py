"""Two names of a set that say what one can say."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.physics.actuation import ActuatorBias
from torch_activegp.physics.body import BodyEffect
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
        laws = [e for e in effects if e.key == (TWO_SIDED, dry.target) and dry.name in e.covers]
        for steady, value in pairs if dry.name == "coulomb_friction" else ():
            force = constant(steady, value, dry.target)
            two_sided = np.array([level[0] - force, level[0] + force])
            others = [(e, v) for e, v in pairs if e is not dry and e is not steady]
            out += [[*others, (law, two_sided)] for law in laws if force and law.plausible(two_sided)]
    return out


def _springs_at_rest(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """A spring that rests elsewhere in place of one at the model's zero and something constant."""
    out: list[list[Pair]] = []
    for spring, stiffness in pairs:
        forms = [e for e in effects if isinstance(spring, CenteredSpring) and e.key == spring.key]
        for steady, value in pairs if forms else ():
            force = push(steady, value, spring.target)
            others = [(e, v) for e, v in pairs if e is not spring and e is not steady]
            resting = [form for form in forms if isinstance(form, LinearSpring)]
            out += [[*others, (form, np.array([stiffness[0], force]))] for form in resting if force]
    return out


def rests_of(springs: Sequence[Effect], effects: Sequence[Effect]) -> list[Effect]:
    """Those constant forces that say where one of some springs rests."""
    centered = [spring.target for spring in springs if isinstance(spring, CenteredSpring)]
    return [effect for effect in effects if any(push(effect, np.ones(1), target) for target in centered)]


def pushes_alone(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """A constant force, or a drive's bias, in place of a spring: one that hardly stiffens is a push from far away."""

    def preload(effect: Effect, value: Array, target: str) -> float:
        return float(value[1]) if isinstance(effect, LinearSpring) and effect.target == target else 0.0

    return as_pushes(pairs, effects, preload)


def as_pushes(
    pairs: Sequence[Pair], effects: Sequence[Effect], force: Callable[[Effect, Array, str], float]
) -> list[list[Pair]]:
    """A set with a constant force, or a drive's bias, in place of each effect that exerts one.

    Args:
        pairs: effects and their parameters.
        effects: what is tried.
        force: of an effect with some parameters on a joint, N m or N; 0 where it exerts none.
    """
    out: list[list[Pair]] = []
    for effect, value in pairs:
        for other in (one for one in effects if all(one.key != e.key for e, _ in pairs)):
            target = other.acts_on
            unit, there = push(other, np.ones(1), target), force(effect, value, target)
            if unit and there:
                out.append([*((e, v) for e, v in pairs if e is not effect), (other, np.array([there / unit]))])
    return out


def constant(effect: Effect, value: Array, target: str) -> float:
    """The constant force of an effect on a joint, N m or N, gravity's pull on a slide among them."""
    return effect.push(value, target) if isinstance(effect, GravityError) else push(effect, value, target)


def push(effect: Effect, value: Array, target: str) -> float:
    """The constant force of an effect on a joint, N m or N."""
    if effect.key == ("constant_force", target):
        return float(value[0])
    if isinstance(effect, ActuatorBias) and effect.drives == target:
        return float(value[0]) * effect.nominal_gain * effect.gear
    return 0.0


def loads_beside(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """A load somewhere on the body before or after in place of a load and another centre of mass of its body.

    It begins in the centre of that body. Aside on an arm's hand, a load stood at the end of the wrist, and the wrist's
    centre of mass was off: both left 0.9951 of the noise, and 0.9943 the one, in a plane; anywhere as little, at the
    price of a parameter that cost more than that.
    """
    out: list[list[Pair]] = []
    aside, held = [form for form in effects if isinstance(form, PayloadAside)], {effect.key for effect, _ in pairs}
    for (load, mass), _, others in _loads_with_shifts(pairs):
        body = load.body
        parents = {form.parent for form in aside if form.body == body}
        beside = [form for form in aside if (form.parent == body or form.body in parents) and form.key not in held]
        out += [[*others, (form, np.array([mass[0], *[0.0] * len(form.axes)]))] for form in beside]
    return out


def _loads_elsewhere(pairs: Sequence[Pair], effects: Sequence[Effect]) -> list[list[Pair]]:
    """A load at another place instead of a load and another centre of mass of the body that carries it."""
    out: list[list[Pair]] = []
    for (load, mass), (shift, by), others in _loads_with_shifts(pairs):
        moved = np.zeros(3)
        moved[list(shift.axes)] = by
        there = load.offsets(mass[None])[0] if isinstance(load, PayloadMass) else np.zeros(3)
        forms = (form for form in effects if form.key == load.key and isinstance(form, PayloadAside))
        fitting = [form for form in forms if set(shift.axes) <= set(form.axes)]
        out += [[*others, (form, form.moving(float(mass[0]), there, moved))] for form in fitting]
    return out


def _loads_with_shifts(
    pairs: Sequence[Pair],
) -> Iterator[tuple[tuple[BodyEffect, Array], tuple[CenterOfMassOffset, Array], list[Pair]]]:
    """Each load of a set with another centre of mass of its body, and the rest of the set."""
    for load, mass in pairs:
        if not isinstance(load, BodyEffect) or load.name != "payload_mass" or mass[0] <= 0.0:
            continue
        for shift, by in pairs:
            if isinstance(shift, CenterOfMassOffset) and shift.target == load.target:
                yield (load, mass), (shift, by), [(e, v) for e, v in pairs if e is not load and e is not shift]
