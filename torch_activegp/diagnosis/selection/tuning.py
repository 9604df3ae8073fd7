"""A nominal that was tuned on these recordings: what is missing hides behind wrong values of what was tuned."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from torch_activegp.diagnosis.selection.compared import Selection, fitted
from torch_activegp.diagnosis.selection.merging import rests_of
from torch_activegp.diagnosis.selection.proposals import Set, diverse, join, with_values
from torch_activegp.diagnosis.selection.screening import Atom, Screen, screen
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE
from torch_activegp.physics.effect import Effect

_MOST = 4
_MORE = 20.0
_HELPED = 1.05
"""What is tuned must add 5 % to what the best effect gains alone,"""
_NEARLY = 0.9
"""and reach most of what other company gains, to be tried."""
_HIDDEN = (0.15, 0.4, 0.75)
"""Largest gain alone over the gain beside the rest, of one, two, or more that undo a tuning. Tuned cases measured 0 to
0.7, with many corrections each, and 0.13 with one; effects of their own mostly above 1, 0.36 where one hides the other,
and 0.19 a bias behind cogging and hysteresis."""
_MANY, _OF_MANY = 4, 1.6
"""The same of so many, where no few names explain as much: tunings that had gone wrong measured 0.93, 0.95 and 1.47.
Where few do, such as a payload, it is they that are missing: many corrections do the same to a machine of one joint."""
_CERTAIN = 1.1
"""The same where a damping comes out below zero, on its joint: the nominal has more than there is, and that was put
there by a modeller."""
_OPTIMUM = 0.9
"""All that is tunable together gains less than this part of what the best set explains, behind a tuning."""
_FEW, _TOO_MUCH = 3, 0.47
"""So few corrections undo no tuning where one tunable effect, whichever, gains more than this part alone: who had tuned
would have found it. Tuned nominals measured 0.002 to 0.13, 0.42 where dry friction was tuned that creeps and the
machine's sticks, and 0.49 with five corrections; 0.53, 0.71 and 0.88 were measured where a gain or a rotor beside a
spring, a drag or a sensor's gain only happened to gain nothing alone."""
_SINGLE = 0.3
"""One correction undoes no tuning where all that is tunable together gains more than this part, to first order: the
missing one would have moved the others too. An armature beside a cubic spring on a drive of two masses gained 0.01 of
what it gained beside the spring, for the one slows what the other quickens, and with a gain 0.5."""
_CLEARLY = 100.0
"""Chi2, in units of what is left, by which corrections fit clearly better than names, beyond what parameters gain."""
_LIKELY = (0.4, 0.6, 0.85)
"""The same to first order, for what is worth a fit: 8 of 11 tuned cases measured 0.08 to 0.66, two effects 0.5 to 3."""


def beside(screened: Screen, price: float, alone: float, together: float) -> list[list[Atom]]:
    """Effects together with those tunable ones that pay beside them, best first; none where that helps little.

    What a modeller has tuned (damping, rotor, gain, bias) gains little alone, and what is missing gains little alone
    too: it hides behind their wrong values, and shows only when they are free. Where what is tunable gains nearly as
    much alone, nothing hides.

    Args:
        screened: score test on top of the nominal.
        price: what a parameter must gain.
        alone: what the best effect alone gains; a tuning must help more.
        together: what the best effects in any company gain; with a tuning they must gain nearly as much.
    """
    tunable = [atom for atom in screened.best() if atom.effect.tunable]
    least = max(alone + _MORE, _HELPED * alone, _NEARLY * together)
    found = [(screened.joint_gain([a, *tunable]), a) for a in screened.atoms if not a.effect.tunable]
    found = [(gain, a) for gain, a in found if gain > least]
    chosen: list[tuple[float, list[Atom]]] = []
    for atom in diverse([a for _, a in sorted(found, key=lambda item: -item[0])], len(found)):
        some = [atom, *paying(screened, [atom], tunable, price)]
        if len(some) > 1:
            gain, values = screened.together(some)
            chosen.append((gain - price * sum(map(len, values[1:])), with_values(some, values)))
        if len(chosen) == _MOST:
            break
    chosen.sort(key=lambda item: -item[0])
    hidden = [(worth, some) for worth, some in chosen if _hide(screened, some)]
    if not hidden or hidden[0][0] < max(least, _NEARLY * chosen[0][0]):
        return []
    return [some for _, some in hidden]


def _hide(screened: Screen, some: Sequence[Atom]) -> bool:
    """Whether tunable effects gain much less alone than beside the first one, to first order."""
    atom, *tunable = some
    added = screened.possible_gain(some) - screened.possible_gain([atom])
    return screened.possible_gain(tunable) < _bar(_LIKELY, len(tunable)) * added


def _overdamped(fit: Fit, effects: Sequence[Effect]) -> bool:
    """Whether a viscous friction comes out below zero on every joint that some effects act on."""
    pairs = list(zip(fit.effects, fit.values, strict=True))
    joints = {e.target for e, v in pairs if e in effects and e.name == "viscous_friction" and v[0] < 0.0}
    return all(e.acts_on in joints for e in effects)


def _bar(shares: Sequence[float], count: int) -> float:
    """The share for one, two, or more."""
    return shares[min(count, len(shares)) - 1]


def at_an_optimum(screened: Screen, explained: float) -> bool:
    """Whether all that is tunable gains little on top of the nominal, next to what is explained: as after a tuning.

    Within its bounds: a damping that was tuned to zero would gain much below.
    """
    return screened.possible_gain(screened.best()) < _OPTIMUM * explained


def undone(fit: Fit, screened: Screen, price: float) -> list[Set]:
    """A fit with all further tunable effects that pay together.

    Args:
        fit: a set, with tunable effects or without.
        screened: score test on top of it.
        price: what a parameter must gain.
    """
    near = paying(screened, [], [a for a in screened.best() if a.effect.tunable], price)
    return [join(fit, near)] if near else []


def paying(screened: Screen, held: Sequence[Atom], tunable: Sequence[Atom], price: float) -> list[Atom]:
    """Those tunable effects without which the rest loses more than their price, to first order.

    Backward elimination: the one with the least Wald statistic goes first.
    """
    near = screened.independent(tunable)
    while near:
        losses = screened.losses([*held, *near])[len(held) :]
        least = min(range(len(near)), key=losses.__getitem__)
        if losses[least] >= price:
            break
        del near[least]
    return near


def is_a_tuning(
    shooting: Shooting, selection: Selection, tunable: Sequence[Effect], others: Sequence[Effect], needed: bool = False
) -> bool:
    """Whether the tunable ones of the best set's effects do no more than undo a tuning: see :func:`only_undoes`.

    Many that no few names make up for are one where they leave noise alone, and none of them gains much by itself or
    names leave clearly more: no machine lacks so much at once. An encoder's offset explained 0.99 of what was missing
    behind six values that were tuned, and 1.8 times the rest by them alone; it was named with a payload, a gain and a
    bias, which lost the held-out runs.

    A constant force that says where a spring rests is a part of the spring: with it, the rotor of a leg's other joint
    made two, and was no name.
    """
    rests = rests_of(others, tunable)
    if 0 < len(rests) < len(tunable):
        tunable, others = [effect for effect in tunable if effect not in rests], [*others, *rests]
    many, quiet = len(tunable) >= _MANY, selection.best.chi2 < NOISE_ALONE * shooting.dof
    clearly = needed and many and quiet
    better = quiet and len(tunable) >= _FEW and _is_better_than_names(selection, len(others))
    if many and better:
        return True
    if (len(tunable) <= _FEW or clearly) and _was_not_tuned(shooting, selection, tunable):
        return False
    if clearly or better:
        return True
    alone, without = (fitted(shooting, selection, some) for some in (tunable, others))
    return only_undoes(selection.nominal, alone, without, selection.best, needed)


def _is_better_than_names(selection: Selection, names: int) -> bool:
    """Whether the best of the sets with few corrections, or none, has more names, and leaves clearly more.

    Such a set may leave nearly as little on a machine of one joint. A pendulum's delay and four corrections left 240
    less than a delay, a centre of mass and a spring, of a mismatch of 658 thousand; the corrections alone gained 1.7
    times what they gained beside the delay, for they had been tuned by another measure than the likelihood. Behind
    seven, of which a rotor gained half of all by itself, six were named beside the dead zone that was missing.
    """
    score, best = selection.score, selection.best
    few = [fit for fit in selection.fits if sum(effect.tunable for effect in fit.effects) < _FEW]
    named = dataclasses.replace(selection, fits=few, score=score.without_free()).best
    clearly = score.scale * (_CLEARLY + score.a_parameter * max(best.size - named.size, 0))
    return len(named.effects) > names and named.chi2 > best.chi2 + clearly


def _was_not_tuned(shooting: Shooting, selection: Selection, tunable: Sequence[Effect]) -> bool:
    """Whether the nominal is far from the optimum of what a modeller would have tuned, for so many corrections.

    As many as count as few say which joints were tuned: the optimum is theirs. Behind a cart's gain, rotor and damping,
    which gained nothing alone, the rotor of a pole that nobody had tuned gained 0.54; gravity that differed was named
    with a load.
    """
    nominal = selection.nominal
    if selection.tunable_gains is None:
        screened = screen(shooting, nominal, selection.tunable)
        atoms = screened.best()
        each = {atom.effect: screened.possible_gain([atom]) for atom in atoms}
        selection.tunable_gains = each, screened.possible_gain(atoms) if atoms else 0.0
    each, together = selection.tunable_gains
    tuned = {effect.acts_on for effect in (tunable if len(tunable) >= _FEW else each)}
    alone = max((gain for effect, gain in each.items() if effect.acts_on in tuned), default=0.0)
    explained = nominal.chi2 - selection.best.chi2
    return alone > _TOO_MUCH * explained or (len(tunable) == 1 and together > _SINGLE * explained)


def only_undoes(nominal: Fit, alone: Fit, without: Fit, best: Fit, needed: bool = False) -> bool:
    """Whether tunable effects do no more than undo a tuning.

    A tuning hides what is missing, and the missing hides the tuning: it gains less alone than beside the rest. Errors
    that have nothing to do with each other gain the same, and such as stand in for each other gain more alone. The more
    there are at once, as a tuning makes them, the less of this is asked.

    Args:
        nominal: the fit without effects.
        alone: with the tunable effects alone.
        without: with the others alone; no worse than the nominal, whatever its fit says.
        best: with all of them.
        needed: whether no few names explain as much.
    """
    share = _CERTAIN if _overdamped(best, alone.effects) else _bar(_HIDDEN, len(alone.effects))
    share = _OF_MANY if needed and len(alone.effects) >= _MANY else share
    return nominal.chi2 - alone.chi2 < share * (min(without.chi2, nominal.chi2) - best.chi2)
