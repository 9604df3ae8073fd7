"""Sets that a low price puts before others that explain more: that of a vector's axes, or of what refines a law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.effect import Effect

_CLEARLY, _SHORT = 20.0, 0.002
"""Chi2, in units of the noise that is left, by which a set outdoes another one (odds of 22 thousand to 1), and the part
of it, if that is more: what fits are short of."""


def is_outdone(fit: Fit, others: Sequence[Fit], score: Score) -> bool:
    """Whether another set leaves clearly less than one with a vector or a law that refines another one.

    Args:
        fit: of a set.
        others: of all sets that a machine can have.
        score: how they compare.
    """
    vectors = {effect for effect in fit.effects if effect.vector and len(effect.parameters) > 1}
    refined = [effect for effect in fit.effects if effect.covers and len(effect.parameters) > 1]
    if not vectors and not refined:
        return False
    least = fit.chi2 - max(_CLEARLY * score.scale, _SHORT * fit.chi2)
    clear = [other for other in others if other.chi2 < least and other.size <= fit.size and not other.at_rest]
    if vectors and _has_cheap_axes(fit, vectors, clear, score):
        return True
    return any(_is_refined_in_vain(fit, law, clear, others, score) for law in refined) if clear else False


def _has_cheap_axes(fit: Fit, vectors: set[Effect], clear: Sequence[Fit], score: Score) -> bool:
    """Whether one of those that leave clearly less has no more names and no more parameters.

    Further components of a vector have next to no price; those of another law must be worth a name. Where neither set
    has more of either, what they leave decides: gravity along two axes and a rotor left 38 more than a load and a
    spring with a rest, which were there, and scored 823 better.
    """
    size, names = _named(fit, score), score.names_in(fit.effects)
    return any(
        score.names_in(other.effects) <= names and _named(other, score) <= size and not vectors <= set(other.effects)
        for other in clear
    )


def _is_refined_in_vain(fit: Fit, law: Effect, clear: Sequence[Fit], others: Sequence[Fit], score: Score) -> bool:
    """Whether a law gains less over a simpler one than a name must, and one more name beside that leaves clearly less.

    What is left then has another place. Behind a gain and a damping of a cart that had been tuned, the damping of its
    pole gained too little for a name, and a friction of the cart that depends on the direction took a third of that.
    """
    rest = fit.keys - {law.key}
    simpler = [rest | {(name, law.target)} for name in law.covers]
    beside = any(len(other.keys) == len(fit.keys) + 1 and any(keys < other.keys for keys in simpler) for other in clear)
    if not beside:
        return False
    chi2 = min((other.chi2 for other in others if other.keys in simpler), default=np.inf)
    return bool(chi2 < fit.chi2 + score.scale * score.cheapest)


def _named(fit: Fit, score: Score) -> int:
    """Parameters of what is more than an undone tuning."""
    return sum(len(v) for e, v in zip(fit.effects, fit.values, strict=True) if e.key not in score.free)
