"""The last fits: sets that nothing tells apart must not seem to differ because one of them ended short."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.selection.compared import Effort, Selection, compare
from torch_activegp.diagnosis.selection.elsewhere import elsewhere
from torch_activegp.diagnosis.selection.impacts import led_back
from torch_activegp.diagnosis.selection.merging import merged
from torch_activegp.diagnosis.selection.more_axes import in_fewer_axes
from torch_activegp.diagnosis.selection.proposals import Set, beginning
from torch_activegp.diagnosis.selection.straightened import straightened
from torch_activegp.diagnosis.shooting.chaining import borrowed, chained
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE
from torch_activegp.physics.effect import Effect

_SETTLED, _CREEPS = 0.5, 1e-4
"""Chi2, or part of it, by which the best set must gain to be fitted once more: fits end where steps gain less."""
_RIVAL = 20.0
_SHORT = 0.04
"""Part of its chi2 by which a fit of a law with kinks may end short of its optimum."""
_OF_THE_GAIN = 0.05
"""And part of what the best set explains: where little is missing, fits do not end that short."""
_BY_CHANCE = 9.0
"""Parameters that differ by less, three standard errors, are the same."""
_NEAR = 6
_POLISHES = 4


def polish(shooting: Shooting, selection: Selection, effects: Sequence[Effect]) -> None:
    """The best set with all derivatives taken there, and its close rivals from the states and parameters that it found.

    Sets that nothing tells apart reach the same chi2 only so, and each may show the others the way; what says the
    same elsewhere is fitted from there too, for it may have been given up in a race. One that overtook the best set
    shows that one the way in turn, however far behind it is now: on a machine that strikes, a spring and a drag left 28
    less than the spring and the damping that was there, by states that these had not tried.
    """
    springs = [some for some in straightened(selection.best, effects) if selection.of(some[0]) is None]
    compare(shooting, selection, springs, selection.best)
    precise = dataclasses.replace(shooting, cheap=None)  # no derivatives but its own
    former: list[Fit] = []
    for number in range(_POLISHES if selection.best.effects else 0):
        best = selection.best
        again = chained(precise, precise.fit([(best.effects, best.values)], best.starts)[0])
        gained = best.chi2 - again.chi2 if again.plausible else 0.0
        if again.plausible and gained > -_SETTLED:  # also where it gains nothing: its derivatives say how sure it is
            selection.fits = [again if fit is best else fit for fit in selection.fits]
            selection.forget_parts()
            best = again
        lost = best.chi2 > NOISE_ALONE * shooting.dof
        if selection.cut_short and lost:  # nothing on the list explains what is missing: rivals would not, either
            break
        stuck = min(_SHORT * best.chi2, _OF_THE_GAIN * (selection.nominal.chi2 - best.chi2))
        near = _near(selection, best, max(2.0 * gained, 0.0), 0.0 if number else stuck)
        near += [fit for fit in former if fit not in near]
        found = [_again(precise, fit, best) for fit in near]
        if not number:
            behind = [fit for fit in selection.ranked()[:_NEAR] if fit is not best and fit not in near]
            found += led_back(precise, best, behind, selection.nominal.chi2)
        near = selection.add(found)
        sets = [some for fit in near if (some := shared(fit, best)) is not None]
        sets += _in_fewer_axes(selection, [best, *near], effects)
        sets += [] if number else [*elsewhere(best, effects), *_one_for_two(selection, best, effects)]
        below = [selection.below(some) for some, _ in sets]
        compare(shooting, selection, sets, best, Effort(race=True), below=below)
        leads = selection.score(selection.best) > selection.score(best) - _SETTLED
        if leads and gained <= max(_SETTLED, _CREEPS * best.chi2):
            break
        former = [best] if selection.best.effects != best.effects else []


def _in_fewer_axes(selection: Selection, fits: Sequence[Fit], effects: Sequence[Effect]) -> list[Set]:
    """Some sets with a vector along one axis less, but those that were fitted as well."""
    found = [(fit, some) for fit in fits for some in in_fewer_axes(fit, effects)]
    known = [selection.of(effects) for _, (effects, _) in found]
    pairs = zip(found, known, strict=True)
    return [some for (fit, some), other in pairs if other is None or other.chi2 > fit.chi2 + _BY_CHANCE]


def _one_for_two(selection: Selection, best: Fit, effects: Sequence[Effect]) -> list[Set]:
    """The best set with one name in place of two that say the same, where one of the two seemed to cost no name."""
    found: list[Set] = []
    for pairs in merged(list(zip(best.effects, best.values, strict=True)), effects):
        some, values = zip(*pairs, strict=True)
        gone = {effect.key for effect in best.effects} - {effect.key for effect in some}
        if gone & selection.score.free and selection.of(some) is None:
            found.append((some, values))
    return found


def _near(selection: Selection, best: Fit, gained: float, stuck: float) -> list[Fit]:
    """Rivals that score nearly as well as the best set, or would if their chi2 fell by what they may be short of.

    Those with more on top began where the best set was: they fall no further than by what that has gained.

    Args:
        selection: the compared sets.
        best: one of them.
        gained: chi2 by which rivals may fall as the best set did.
        stuck: chi2 by which fits may end short of their optimum.
    """
    score, names = selection.score, set(best.effects)
    reach = score(best) + _RIVAL + np.array([max(gained, stuck), gained]) / score.scale
    near = (fit for fit in selection.ranked()[:_NEAR] if fit is not best)
    return [fit for fit in near if score(fit) < reach[int(names < set(fit.effects))]]


def _again(precise: Shooting, fit: Fit, best: Fit) -> Fit:
    """A rival with derivatives taken where it is, and the best set's states where these are better."""
    begin = dataclasses.replace(fit, columns=None, taken=None)
    found = borrowed(precise, begin, best)
    if found is not begin or not fit.effects:
        return found
    return precise.fit([(fit.effects, fit.values)], fit.starts)[0]


def shared(fit: Fit, best: Fit) -> Set | None:
    """A set with the parameters of the best one for what they share or contain; None where they are those of its fit.

    So a law begins no worse than the simpler one that it contains, where the rest is shared. What is no farther than
    chance leads back to the fit.
    """
    found = best.by_effect
    values = tuple(found.get(e, beginning(e, v, found.items())) for e, v in zip(fit.effects, fit.values, strict=True))
    moved = np.concatenate([np.zeros(0), *values]) - np.concatenate([np.zeros(0), *fit.values])
    return (fit.effects, values) if moved @ fit.information @ moved > _BY_CHANCE else None
