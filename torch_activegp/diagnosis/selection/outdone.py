"""Sets that a vector's price puts before others that explain more with no more names and no more parameters."""

from __future__ import annotations

from collections.abc import Sequence

from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.score import Score

_CLEARLY, _SHORT = 20.0, 0.002
"""Chi2, in units of the noise that is left, by which a set outdoes another one (odds of 22 thousand to 1), and the part
of it, if that is more: what fits are short of."""


def is_outdone(fit: Fit, others: Sequence[Fit], score: Score) -> bool:
    """Whether another set leaves clearly less, with no more names and no more parameters than one with a vector.

    Further components of a vector have next to no price; those of another law must be worth a name. Where neither set
    has more of either, what they leave decides: gravity along two axes and a rotor left 38 more than a load and a
    spring with a rest, which were there, and scored 823 better.

    Args:
        fit: of a set.
        others: of all sets that a machine can have.
        score: how they compare.
    """
    vectors = {effect for effect in fit.effects if effect.vector and len(effect.parameters) > 1}
    if not vectors:
        return False
    least = fit.chi2 - max(_CLEARLY * score.scale, _SHORT * fit.chi2)
    size, names = _named(fit, score), score.names_in(fit.effects)
    return any(
        other.chi2 < least
        and other.size <= fit.size
        and score.names_in(other.effects) <= names
        and _named(other, score) <= size
        and not vectors <= set(other.effects)
        and not other.at_rest
        for other in others
    )


def _named(fit: Fit, score: Score) -> int:
    """Parameters of what is more than an undone tuning."""
    return sum(len(v) for e, v in zip(fit.effects, fit.values, strict=True) if e.key not in score.free)
