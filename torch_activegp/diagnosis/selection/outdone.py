"""Sets that another one outdoes with no more names and no more parameters."""

from __future__ import annotations

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.ties import ALIKE
from torch_activegp.diagnosis.shooting.fit import Fit

_CLEARLY = 20.0
"""Chi2, in units of the noise that is left, by which a set outdoes another one: odds of 22 thousand to 1."""


def outdone_by(selection: Selection, fit: Fit) -> Fit | None:
    """The set that leaves clearly less than another one, with no more names and no more parameters; None without any.

    Prices weigh names against what they explain. Where neither set has more of them, what they leave decides: gravity
    along two axes and a rotor, whose second axis costs a vector little, left 38 more than a load and a spring whose
    rest has a price, and scored 823 better.

    Args:
        selection: the compared sets.
        fit: one of them.
    """
    score, names = selection.score, selection.score.names_in(fit.effects)
    least = fit.chi2 - max(_CLEARLY * score.scale, ALIKE * fit.chi2)
    sound = (other for other in selection.fits if other.plausible and not other.at_rest and other.chi2 < least)
    better = (other for other in sound if other.size <= fit.size and score.names_in(other.effects) <= names)
    return min(better, key=lambda other: other.chi2, default=None)


def leave_out_outdone(selection: Selection) -> bool:
    """Forgets sets that score better than the best one that nothing outdoes; returns whether there were any."""
    before = selection.best
    while outdone_by(selection, best := selection.best) is not None:
        selection.fits = [fit for fit in selection.fits if fit is not best]
    return selection.best is not before
