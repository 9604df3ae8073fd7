"""The last fits: sets that nothing tells apart must not seem to differ because one of them ended short."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.chaining import chained
from torch_activegp.diagnosis.compared import Selection, compare
from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.merging import merged
from torch_activegp.diagnosis.numerics import Sets
from torch_activegp.diagnosis.proposals import Set, beginning, late_elsewhere
from torch_activegp.diagnosis.prospects import NOISE_ALONE
from torch_activegp.diagnosis.shooting import Shooting
from torch_activegp.physics.effect import Effect

_SETTLED = 0.5
_RIVAL = 20.0
_SHORT = 0.04
"""Part of its chi2 by which a fit of a law with kinks may end short of its optimum."""
_OF_THE_GAIN = 0.05
"""And part of what the best set explains: where little is missing, fits do not end that short."""
_ALIKE = 1e-3
_NEAR = 6
_POLISHES = 4


def polish(shooting: Shooting, selection: Selection, effects: Sequence[Effect]) -> None:
    """The best set with all derivatives taken there, and its close rivals from the states and parameters that it found.

    Sets that nothing tells apart reach the same chi2 only so, and each may show the others the way; what comes late
    elsewhere is fitted from there too, for it may have been given up in a race.
    """
    precise = dataclasses.replace(shooting, cheap=None)  # no derivatives but its own
    for number in range(_POLISHES if selection.best.effects else 0):
        best = selection.best
        again = chained(precise, precise.fit([(best.effects, best.values)], best.starts)[0])
        gained = best.chi2 - again.chi2 if again.plausible else 0.0
        if again.plausible and gained > -_SETTLED:  # also where it gains nothing: its derivatives say how sure it is
            selection.fits = [again if fit is best else fit for fit in selection.fits]
            best = again
        lost = best.chi2 > NOISE_ALONE * shooting.dof
        if selection.cut_short and lost:  # nothing on the list explains what is missing: rivals would not, either
            break
        stuck = min(_SHORT * best.chi2, _OF_THE_GAIN * (selection.nominal.chi2 - best.chi2))
        short = max(2.0 * gained, 0.0 if number else stuck, 0.0)
        reach = selection.score(best) + _RIVAL + short / selection.score.scale
        near = [fit for fit in selection.ranked()[:_NEAR] if fit is not best and selection.score(fit) < reach]
        sets = [some for fit in near for some in starts_of(fit, best)]
        sets += [] if number else [*late_elsewhere(best, effects), *_one_for_two(selection, best, effects)]
        compare(shooting, selection, sets, best)
        if gained <= _SETTLED and selection.score(selection.best) > selection.score(best) - _SETTLED:
            break


def _one_for_two(selection: Selection, best: Fit, effects: Sequence[Effect]) -> Sets:
    """The best set with one name in place of two that say the same, where one of the two seemed to cost no name."""
    found: list[Set] = []
    for pairs in merged(list(zip(best.effects, best.values, strict=True)), effects):
        some, values = zip(*pairs, strict=True)
        gone = {effect.key for effect in best.effects} - {effect.key for effect in some}
        if gone & selection.score.free and selection.of(some) is None:
            found.append((some, values))
    return found


def starts_of(fit: Fit, best: Fit) -> Sets:
    """A set with its own parameters, and with those of the best one for what they share or contain, where that differs.

    So a law begins no worse than the simpler one that it contains, where the rest is shared.
    """
    found = best.by_effect
    shared = tuple(found.get(e, beginning(e, v, found.items())) for e, v in zip(fit.effects, fit.values, strict=True))
    own = [(fit.effects, fit.values)]
    far = any(not np.allclose(a, b, rtol=_ALIKE) for a, b in zip(shared, fit.values, strict=True))
    return [*own, (fit.effects, shared)] if far else own
