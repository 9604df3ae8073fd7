"""Sets that a low price puts before others that explain more: that of a vector's axes, or of what refines a law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.score import Score

_CLEARLY, _SHORT = 20.0, 0.002
"""Chi2, in units of the noise that is left, by which a set outdoes another one (odds of 22 thousand to 1), and the part
of it, if that is more: what fits are short of."""


def is_outdone(fit: Fit, others: Sequence[Fit], score: Score) -> bool:
    """Whether another set leaves clearly less, with as few names and parameters as one with a vector or a refined law.

    Args:
        fit: of a set.
        others: of all sets that a machine can have.
        score: how they compare.
    """
    clear = [other for other in others if other.chi2 < _clearly_less(fit, score) and not other.at_rest]
    return _as_a_vector(fit, clear, score) or _as_a_refinement(fit, clear, others, score)


def _clearly_less(fit: Fit, score: Score) -> float:
    return fit.chi2 - max(_CLEARLY * score.scale, _SHORT * fit.chi2)


def _as_a_vector(fit: Fit, clear: Sequence[Fit], score: Score) -> bool:
    """Whether one of those that leave clearly less has no more names and no more parameters.

    Further components of a vector have next to no price; those of another law must be worth a name. Where neither set
    has more of either, what they leave decides: gravity along two axes and a rotor left 38 more than a load and a
    spring with a rest, which were there, and scored 823 better.
    """
    vectors = {effect for effect in fit.effects if effect.vector and len(effect.parameters) > 1}
    if not vectors:
        return False
    size, names = _named(fit, score), score.names_in(fit.effects)
    return any(
        other.size <= fit.size
        and score.names_in(other.effects) <= names
        and _named(other, score) <= size
        and not vectors <= set(other.effects)
        for other in clear
    )


def _as_a_refinement(fit: Fit, clear: Sequence[Fit], others: Sequence[Fit], score: Score) -> bool:
    """Whether a law gains so little over a simpler one that it would not be worth a name, and a name beside that more.

    What is left then has another place. Behind a tuned gain and a damping that was tuned 0.016 too low on a cart, the
    damping of its pole was worth no name, and a friction of the cart that depends on the direction took a third of what
    it gained.
    """
    for law in fit.effects:
        simpler = {fit.keys - {law.key} | {(name, law.target)} for name in law.covers}
        least = min((other.chi2 for other in others if other.keys in simpler), default=np.inf)
        more = len(law.parameters) - 1
        if fit.chi2 < least < fit.chi2 + score.scale * score.a_name * more and any(
            other.size <= fit.size
            and len(other.keys) == len(fit.keys) + 1
            and any(keys < other.keys for keys in simpler)
            for other in clear
        ):
            return True
    return False


def _named(fit: Fit, score: Score) -> int:
    """Parameters of what is more than an undone tuning."""
    return sum(len(v) for e, v in zip(fit.effects, fit.values, strict=True) if e.key not in score.free)
