"""Sets tried on a part of the data first: most that look promising to first order need no fit to all of it."""

from __future__ import annotations

from collections.abc import Sequence

from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.proposals import Set
from torch_activegp.diagnosis.score import Score
from torch_activegp.diagnosis.shooting import Shooting

PART = 0.2
"""Least share of the segments."""
_CLEAR = 100.0
"""What a set must gain on all data is to be as much on the part: far above the noise of a gain."""
_LENIENT = 0.3
"""And so much of it is enough there: effects act more in some segments than in others."""


def heat(shooting: Shooting, sets: Sequence[Set], fit: Fit, score: Score) -> list[Set]:
    """Those of some sets that gain on a part of the data about what they must gain on all of it.

    Half of the part are the segments that the fit explains worst. Where little is missing all data are needed to see
    it, and all sets pass.

    Args:
        shooting: the likelihood.
        sets: what is proposed, with first guesses.
        fit: what they are to be better than.
        score: what they must gain.

    Returns:
        The sets, with the parameters found on the part.
    """
    paid = score.price(fit.effects)
    priced = [(some, score.price(some[0]) - paid) for some in sets]
    dear = [(some, price) for some, price in priced if price > _CLEAR]
    if not dear:
        return list(sets)
    share = max(_CLEAR / min(price for _, price in dear), PART)
    part, which = shooting.subset(share, fit.per_segment)
    if part.segments.size == shooting.segments.size:
        return list(sets)
    least = _LENIENT * part.segments.size / shooting.segments.size * score.scale
    passed = near(part, [some for some, _ in dear], fit.pick(which), [-least * price for _, price in dear])
    return [some for some, price in priced if price <= _CLEAR] + passed


def near(part: Shooting, sets: Sequence[Set], here: Fit, bars: Sequence[float]) -> list[Set]:
    """Those of some sets whose chi2 on a part of the data is below that of a fit and a bar on top, one for each."""
    trials = part.fit(sets, here.starts, race=True, design=here.design)
    return [(fit.effects, fit.values) for fit, bar in zip(trials, bars, strict=True) if fit.chi2 < here.chi2 + bar]
