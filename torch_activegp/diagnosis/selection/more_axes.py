"""Vectors along one more axis than a first look gives them, or along one less than they need."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.proposals import Set, paired
from torch_activegp.diagnosis.selection.screening import Atom, Screen, without
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.effect import Effect

Worth = Callable[[float, Sequence[Effect]], float]
_Grown = list[tuple[Effect, tuple[Atom, ...]]]
"""Effects, each with its atoms along single axes."""
_NOTHING = 9.0
"""Chi2 that a component which may be none takes away where all else follows: three standard errors."""


def in_more_axes(
    sets: Iterable[Sequence[Atom]], screened: Screen, effects: Sequence[Effect], worth: Worth, least: float
) -> list[Sequence[Atom]]:
    """Some sets with a vector in them along more axes, one by one, where each is worth more to first order.

    Forms along several axes are not screened, and come in place of a single one in the best set alone. The centre of
    mass of a shank that had moved along two axes, beside a lag, was never looked at: behind a payload and a bias in its
    place, one axis was too far from the best.

    Args:
        sets: the sets.
        screened: the score test that they come from.
        effects: what is tried.
        worth: of a gain by some effects, less their price.
        least: what one more axis must add to the worth.
    """
    single = {(atom.effect.key, atom.effect.variant): atom for atom in screened.best() if atom.effect.vector}
    found: dict[frozenset[Effect], Sequence[Atom]] = {}  # two single axes may make the same

    def worth_of(grown: _Grown) -> float:
        return worth(screened.joint_gain([atom for _, axes in grown for atom in axes]), [effect for effect, _ in grown])

    for company in sets:
        grown: _Grown = [(atom.effect, (atom,)) for atom in company]
        best, more = worth_of(grown), False
        while ways := [(worth_of(some), some) for some in _in_one_more(grown, single, effects)]:
            now, some = max(ways, key=lambda way: way[0])
            if now <= best + least:
                break
            best, grown, more = now, some, True
        if more:
            found.setdefault(frozenset(effect for effect, _ in grown), _joined(grown, screened))
    return [*found.values()]


def _in_one_more(
    grown: _Grown, single: Mapping[tuple[tuple[str, str], str], Atom], effects: Sequence[Effect]
) -> Iterator[_Grown]:
    """Some effects with one of them, a vector, along one more axis, in each way."""
    for number, (effect, axes) in enumerate(grown):
        if not effect.vector:
            continue
        for form in (form for form in effects if form.key == effect.key and set(effect.variant) < set(form.variant)):
            more = "".join(axis for axis in form.variant if axis not in effect.variant)
            if (form.key, more) in single:
                yield [*grown[:number], (form, (*axes, single[form.key, more])), *grown[number + 1 :]]


def _joined(grown: _Grown, screened: Screen) -> list[Atom]:
    """One atom for each effect, with the values along all its axes in their order."""
    _, found = screened.together([atom for _, axes in grown for atom in axes])
    rest, out = iter(found), []
    for effect, axes in grown:
        values, gain = [next(rest) for _ in axes], axes[0].gain
        if len(axes) > 1:
            gain = screened.joint_gain(axes)
            letters = "".join(atom.effect.variant for atom in axes)
            own = dict(zip(letters, np.concatenate(values), strict=True))
            values = [np.array([own[axis] for axis in effect.variant])]
        out.append(dataclasses.replace(axes[0], effect=effect, values=values[0], gain=gain))
    return out


def in_fewer_axes(fit: Fit, effects: Sequence[Effect]) -> list[Set]:
    """A set with a vector in it along one axis less, for each component that may be none beside the others.

    A centre of mass on the axis of its joint only adds inertia where it moves, in whichever direction, and by the
    square of that: no derivative leads away from there. Along two axes a fit had got away, to the same chi2 as the
    rotor's inertia, but at the price of one component more, and no tie said so.

    Args:
        fit: of the set.
        effects: what is tried.
    """
    found: list[Set] = []
    if not fit.is_known:
        return found
    for effect, value in fit.by_effect.items():
        if not effect.vector or len(value) < 2:
            continue
        first = fit.places[effect].start
        others = [(e, v) for e, v in fit.by_effect.items() if e is not effect]
        lost = [_alone(fit.information, first + axis) * value[axis] ** 2 for axis in range(len(value))]
        for axis in np.flatnonzero(np.array(lost) < _NOTHING):
            left = effect.variant[:axis] + effect.variant[axis + 1 :]
            forms = (form for form in effects if form.key == effect.key and form.variant == left)
            found += [paired([*others, (form, np.delete(value, axis))]) for form in forms]
    return found


def _alone(information: Array, number: int) -> float:
    """What is known of a parameter that no other one makes up."""
    order = [*(i for i in range(len(information)) if i != number), number]
    left, _ = without(len(order) - 1, information[np.ix_(order, order)], np.zeros(len(order)))
    return float(left[0, 0])
