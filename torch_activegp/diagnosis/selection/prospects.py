"""Which sets are worth developing further."""

from __future__ import annotations

from collections.abc import Collection, Iterable

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE
from torch_activegp.physics.effect import Effect

MAX_EFFECTS = 4
_HOPELESS = 0.5


def cannot_win(selection: Selection, fit: Fit) -> bool:
    """Whether a set costs more than the best one, which leaves noise alone and was developed to no avail."""
    best, score = selection.best, selection.score
    done = score.scale < NOISE_ALONE and frozenset(best.effects) in selection.developed
    return done and score.price(fit.effects) > score.price(best.effects)


def is_alike(selection: Selection, fit: Fit, expanded: Collection[frozenset[Effect]]) -> bool:
    """Whether a set that was developed has the same names, and differs in what is no name alone.

    The best set must explain hardly more than that one too: less than one more name must.
    """
    score = selection.score

    def names(effects: Iterable[Effect]) -> frozenset[Effect]:
        return frozenset(effect for effect in effects if effect.key not in score.free)

    def explains_more(some: frozenset[Effect]) -> bool:
        known = selection.of(tuple(some))
        return known is None or known.chi2 - fit.chi2 > score.cheapest * score.scale

    if len(names(fit.effects)) == len(fit.effects):
        return False
    alike = (some for some in expanded if len(names(some)) < len(some) and names(some) == names(fit.effects))
    return any(fit is not selection.best or not explains_more(some) for some in alike)


def hopeless(selection: Selection, shooting: Shooting, least: int = 1) -> bool:
    """Whether some effects together leave most of a large mismatch: what is missing is not on the list."""
    there = selection.nominal.chi2 - shooting.dof
    return len(selection.best.effects) >= least and there > 0.2 * shooting.dof and leaves_most(selection, shooting)


def leaves_most(selection: Selection, shooting: Shooting) -> bool:
    """Whether the best set leaves the larger part of the mismatch, however small that is."""
    there, left = (fit.chi2 - shooting.dof for fit in (selection.nominal, selection.best))
    return left > _HOPELESS * there
