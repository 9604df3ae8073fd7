"""The same motion by another name at another place: what comes late, and what pushes."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from torch_activegp.diagnosis.selection.merging import as_pushes, constant
from torch_activegp.diagnosis.selection.proposals import Set, paired
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.actuator import ActuatorEffect
from torch_activegp.physics.effect import Effect

_LATE = ({"actuator_delay", "sensor_delay"}, {"actuator_lag", "sensor_delay"}, {"actuator_delay", "actuator_lag"})


def elsewhere(best: Fit, effects: Sequence[Effect]) -> list[Set]:
    """A set with what may make the same motion in place of each of its effects.

    Args:
        best: the set.
        effects: what is tried.
    """
    return [*late_elsewhere(best, effects), *pushed_elsewhere(best, effects)]


def pushed_elsewhere(best: Fit, effects: Sequence[Effect]) -> list[Set]:
    """A set with a constant force as a drive's bias, a bias as a constant force, and either in place of gravity's pull.

    What is constant at a joint is the same force whoever exerts it: nothing recorded there tells them apart.
    """
    pairs = list(zip(best.effects, best.values, strict=True))
    return [paired(some) for some in as_pushes(pairs, effects, constant)]


def late_elsewhere(best: Fit, effects: Sequence[Effect]) -> list[Set]:
    """A set with the encoder late by as much as the drive was, or the drive as the encoder, or in another way.

    Often they make the same motion: a delay much shorter than the time between rows, for instance, and such a lag. So
    do two of them together and one that is as late as both.
    """
    pairs = list(zip(best.effects, best.values, strict=True))
    out: list[Set] = []
    for late, value in pairs:
        for other in (effect for effect in effects if _late_alike(late, effect)):
            others = [(e, v) for e, v in pairs if e is not late and e.key != other.key]
            out.append(paired([*others, (other, value)]))
    for (late, value), (again, more) in itertools.combinations(pairs, 2):
        for other in effects if _late_alike(late, again) else ():
            if other in (late, again) or (_late_alike(late, other) and _late_alike(again, other)):
                others = [(e, v) for e, v in pairs if e.key not in (late.key, again.key, other.key)]
                out.append(paired([*others, (other, value + more)]))
    return out


def _late_alike(one: Effect, other: Effect) -> bool:
    """Whether both make the same motion late, in two ways or at two places."""
    return {one.name, other.name} in _LATE and _moves_the_same(one, other)


def _moves_the_same(one: Effect, other: Effect) -> bool:
    """Whether two effects are of one actuator, or of an actuator and the encoder of the joint that it moves."""
    return one.target == other.target or _drives(one, other) or _drives(other, one)


def _drives(drive: Effect, read: Effect) -> bool:
    """Whether the first is of an actuator that moves the joint of the second, which is of no actuator."""
    of_two = isinstance(read, ActuatorEffect)
    return isinstance(drive, ActuatorEffect) and not of_two and drive.acts_on == read.acts_on
