"""Which sets are worth a fit: from a score test, and from laws that contain others."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.merging import TWO_SIDED, loads_beside, merged, push, pushes_alone
from torch_activegp.diagnosis.selection.screening import Atom
from torch_activegp.diagnosis.shooting.elimination import invert, wald
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.soft_friction import SOFT

Set = tuple[tuple[Effect, ...], tuple[Array, ...]]
Worth = Callable[[tuple[Atom, ...]], float]

MOST = 6
_BEAM = 6
_BEST = 2
_START = 0.15


def diverse(atoms: Sequence[Atom], most: int = MOST) -> list[Atom]:
    """The first few, no more than two of one name and target."""
    count: dict[tuple[str, str], int] = {}
    chosen = []
    for atom in atoms:
        key = atom.effect.key
        count[key] = count.get(key, 0) + 1
        if count[key] <= 2:
            chosen.append(atom)
        if len(chosen) == most:
            break
    return chosen


def companies(atoms: Sequence[Atom], worth: Worth, most: int, least: float) -> list[tuple[Atom, ...]]:
    """Sets of two or more that are worth more than all smaller ones, to first order: a forward search with a beam.

    Effects that hide each other, such as the dry and viscous friction of one joint, are seen together before either is.
    Laws that contain others stay out: :func:`richer` brings them where a simple one is found.

    Args:
        atoms: what to choose from.
        worth: of a set, less its price.
        most: size of the largest set.
        least: what one more effect must add to the worth.
    """
    beam: list[tuple[Atom, ...]] = [()]
    simple = [atom for atom in atoms if not atom.effect.covers]
    top = 0.0
    found: list[tuple[Atom, ...]] = []
    for size in range(1, most + 1):
        larger = {
            frozenset(a.effect.key for a in company): company
            for company in sorted(
                ((*old, a) for old in beam for a in simple if a.effect.key not in {o.effect.key for o in old}),
                key=worth,
            )
        }
        beam = sorted(larger.values(), key=worth, reverse=True)[:_BEAM]
        if not beam:
            break
        better = [company for company in beam[:_BEST] if worth(company) > top + least]
        if size == 1:
            top = max(worth(beam[0]), 0.0)
        elif better:
            top = worth(better[0])
            found += better
        else:
            break
    return found


def with_values(atoms: Sequence[Atom], values: Sequence[Array]) -> list[Atom]:
    """Atoms with other parameters, those of a joint solution for example."""
    return [dataclasses.replace(a, values=v) for a, v in zip(atoms, values, strict=True)]


def also_from(atoms: Sequence[Atom]) -> list[Sequence[Atom]]:
    """The atoms, and the same with other values where first-order ones may lead nowhere."""
    out: list[Sequence[Atom]] = [atoms]
    others = [atom.effect.starts_beside(atom.values) for atom in atoms]
    for number in range(max(map(len, others), default=0)):
        values = [more[min(number, len(more) - 1)] if more else a.values for a, more in zip(atoms, others, strict=True)]
        out.append(with_values(atoms, values))
    return out


def join(fit: Fit, atoms: Iterable[Atom]) -> Set:
    """The fit's effects without those that the new ones contain, and the new ones, which take over their part.

    What is there already, and comes once more, becomes one effect with it.
    """
    effects, values = list(fit.effects), list(fit.values)
    for atom in atoms:
        there = [i for i, e in enumerate(effects) if e.key == atom.effect.key]
        for i in there:
            if (twice := effects[i].once_more(values[i], atom.values)) is not None:  # else it acts as often as it may
                effects[i], values[i] = twice
        if there:
            continue
        more = atom.values.copy()
        inside = [i for i, e in enumerate(effects) if contains(atom.effect, e)]
        for i in inside:
            more += of_part(atom.effect, float(values[i][0])) if effects[i].linear == 1 else 0.0
        effects = [*(e for i, e in enumerate(effects) if i not in inside), atom.effect]
        values = [*(v for i, v in enumerate(values) if i not in inside), more]
    return tuple(effects), tuple(values)


def richer(fit: Fit, effects: Sequence[Effect]) -> list[Set]:
    """The fit with a law that contains another one in its place, at every seed.

    A score test does not see them all: where friction holds a joint, a force on it moves nothing.
    """
    out: list[Set] = []
    for k, old in enumerate(fit.effects):
        for effect in effects:
            if not contains(effect, old) or old.linear != 1 or effect.stands_in:
                continue
            others = [(e, v) for i, (e, v) in enumerate(zip(fit.effects, fit.values, strict=True)) if i != k]
            for seed in effect.seeds:
                value = beginning(effect, seed, [(old, fit.values[k])])
                if effect.name == "stribeck_friction":
                    value[1] = _START * abs(value[0])
                out.append(((*(e for e, _ in others), effect), (*(v for _, v in others), value)))
    return out


def beginning(effect: Effect, value: Array, pairs: Iterable[tuple[Effect, Array]]) -> Array:
    """Parameters of a law with which it is the simpler one among some in its place, or its own where there is none.

    What shapes it (:attr:`Effect.linear`) stays.
    """
    for old, there in pairs:
        if contains(effect, old) and old.linear == 1:
            return effect.absent(value) + of_part(effect, float(there[0]))
    return value


def simpler(
    best: Fit,
    effects: Sequence[Effect],
    known: Mapping[frozenset[Effect], float],
    close: float,
    free: Collection[tuple[str, str]] = (),
) -> list[Set]:
    """A set without each of its names, with a simpler law in place of one that contains it, or in another form.

    Of a backlash there are eight forms; they come last, :func:`with_another_past`.

    Args:
        best: the set.
        effects: what is tried.
        known: chi2 of the sets that were fitted; they are left out.
        close: but a simpler law whose fit is worse than this may have got stuck elsewhere, and is tried from here.
        free: (name, target) pairs that are no names; they stay.
    """
    pairs = list(zip(best.effects, best.values, strict=True))
    plain: list[Set] = []
    for effect, value in ((e, v) for e, v in pairs if e.key not in free):
        others = [(e, v) for e, v in pairs if e is not effect]
        for law in effects:
            alike = len(law.parameters) == 1 or law.variant == effect.variant
            if contains(effect, law) and law.linear == 1 and alike:
                simple = law.taking_over(effect, value)
                simple[0] = value[: effect.linear].mean()
                alone = [*others, (law, simple)]
                plain += [paired([*alone, *more]) for more in ([], *_offset(best, effect, value, effects, free))]
    plain += [*map(paired, [*merged(pairs, effects), *pushes_alone(pairs, effects)]), *_once_less(pairs, effects)]
    plain += map(paired, loads_beside(pairs, effects))
    fresh = [some for some in _fewer(best, effects, known, free) if not _changes_past(some, best)]
    return fresh + [some for some in plain if known.get(frozenset(some[0]), np.inf) > close]


def with_another_past(
    best: Fit, effects: Sequence[Effect], known: Collection[frozenset[Effect]], free: Collection[tuple[str, str]] = ()
) -> list[Set]:
    """A set with another form of a name in it that remembers, and so without each of the others.

    Args:
        best: the set.
        effects: what is tried.
        known: the sets that were fitted; they are left out.
        free: (name, target) pairs that are no names; they stay.
    """
    return [some for some in _fewer(best, effects, known, free) if _changes_past(some, best)]


def _fewer(
    best: Fit, effects: Sequence[Effect], known: Collection[frozenset[Effect]], free: Collection[tuple[str, str]]
) -> list[Set]:
    """A set with another form of each of its names, and without each of the others; not those that are known."""
    pairs = list(zip(best.effects, best.values, strict=True))
    fewer = other_forms(pairs, effects)
    for effect in (e for e in best.effects if e.key not in free):
        others = [pair for pair in pairs if pair[0] is not effect]
        fewer += [paired(others), *other_forms(others, effects)] if others else []
    return [some for some in fewer if frozenset(some[0]) not in known]


def _changes_past(some: Set, best: Fit) -> bool:
    """Whether a name in a set remembers, and is in another form in the best one."""
    return any(effect.needs_past and effect not in best.effects and effect.key in best.keys for effect in some[0])


def contains(law: Effect, other: Effect) -> bool:
    """Whether a law holds another one at the same place for some of its parameters."""
    return other.target == law.target and other.name in law.covers


def holds_simpler_law(some: Set, best: Fit) -> bool:
    """Whether a set has a law in place of one of the best set's that contains it."""
    return any(contains(effect, law) for effect in best.effects if effect not in some[0] for law in some[0])


def softened(sets: Iterable[Set], effects: Sequence[Effect]) -> list[Set]:
    """Those of some sets that hold a firm law, with a soft form of it in its place."""
    out: list[Set] = []
    for some in sets:
        pairs = list(zip(*some, strict=True))
        soft = {
            e: form for e, _ in pairs for form in effects if form.key == e.key and form.variant == SOFT != e.variant
        }
        if soft:
            out.append(paired([(soft[e], soft[e].taking_over(e, v)) if e in soft else (e, v) for e, v in pairs]))
    return out


def other_forms(
    pairs: Sequence[tuple[Effect, Array]], effects: Sequence[Effect], of: Effect | None = None
) -> list[Set]:
    """A set with another form of one of its names: what one form leaves to a second name, another may hold alone.

    Args:
        pairs: the set's effects, and their parameters.
        effects: what is tried.
        of: the one that takes another form; each in turn where there is none.
    """
    return [
        paired([*((e, v) for e, v in pairs if e is not effect), (form, form.taking_over(effect, value))])
        for effect, value in pairs
        if of is None or effect is of
        for form in effects
        if form.key == effect.key and form is not effect and (form.stands_in or effect.stands_in) and not form.more
    ]


def _once_less(pairs: Sequence[tuple[Effect, Array]], effects: Sequence[Effect]) -> list[Set]:
    """A set in which an effect that acts several times does so once less."""
    out: list[Set] = []
    for effect, value in pairs:
        families = [form.family() for form in effects if form.key == effect.key and form.more is not None]
        for before, more in (pair for family in families for pair in itertools.pairwise(family) if pair[1] is effect):
            others = [(e, v) for e, v in pairs if e is not more]
            out += [paired([*others, (before, fewer)]) for fewer in more.once_less(value)]
    return out


def paired(pairs: Sequence[tuple[Effect, Array]]) -> Set:
    """A set of effects and their parameters."""
    return tuple(e for e, _ in pairs), tuple(v for _, v in pairs)


def _offset(
    best: Fit, effect: Effect, value: Array, effects: Sequence[Effect], free: Collection[tuple[str, str]]
) -> list[list[tuple[Effect, Array]]]:
    """What an asymmetric friction has beyond a symmetric one: a constant force, or a drive's bias that is no name."""
    if effect.name != TWO_SIDED:
        return []
    pushes = [(e, push(e, np.ones(1), effect.target)) for e in effects if e.key not in best.keys]
    wanted = -0.5 * float(value[0] - value[1])
    return [[(e, np.array([wanted / p]))] for e, p in pushes if p and (e.name == "constant_force" or e.key in free)]


def without_weak(fit: Fit, price: Callable[[Effect], float]) -> Set | None:
    """The fit without all effects whose parameters are worth less than their price; None where there is none such."""
    inverse = invert(fit.information)
    kept = []
    for effect, values in fit.by_effect.items():
        part = fit.places[effect]
        worth = wald(values, inverse[part, part])
        if not effect.linear or worth > price(effect):
            kept.append((effect, values))
    if len(kept) in (0, len(fit.effects)):
        return None
    return tuple(e for e, _ in kept), tuple(v for _, v in kept)


def of_part(effect: Effect, amplitude: float) -> Array:
    """The part of an effect's parameters that a simpler law of some amplitude makes."""
    out = np.zeros(len(effect.parameters))
    out[: effect.linear if effect.name.startswith("asymmetric") else 1] = amplitude
    return out
