"""Rival names behind a tuned nominal, each beside the same corrections of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Sequence

import numpy as np

from torch_activegp.diagnosis.selection.compared import Selection, compare
from torch_activegp.diagnosis.selection.proposals import Set
from torch_activegp.diagnosis.selection.prospects import MAX_EFFECTS
from torch_activegp.diagnosis.selection.screening import screen
from torch_activegp.diagnosis.selection.tuning import is_a_tuning
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.effect import Effect

_MOST = 5
_FAR = 4
"""Corrections by whose price rivals may be behind."""


def correct_alike(selection: Selection, shooting: Shooting, effects: Sequence[Effect]) -> None:
    """Fits the best names beside all that a modeller tunes at their joints; from then on corrections cost nothing.

    Whoever tunes a nominal moves all of its numbers. A name for which two of them were enough was taken for a better
    one than the true name with four: a sensor's gain for a spring, though the spring left less.

    Args:
        selection: sets behind a nominal that seems to be tuned; unchanged where it does not, or where the corrections
            would be more than that, or where the best names explain less beside them than beside their own: a rotor is
            like a gain to first order, but none is lighter than nothing, and it left 9.9 times the noise.
        shooting: the likelihood.
        effects: what is tried.
    """
    free = selection.score.free
    if not free or selection.cut_short:
        return
    rivals = _rivals(selection)
    if not rivals:
        return
    joints = {effect.acts_on for fit in rivals for effect in fit.effects}
    tunable = [effect for effect in effects if effect.key in free and effect.acts_on in joints]
    screened = screen(shooting, selection.nominal, tunable)
    taken = [effect for fit in rivals for effect in fit.effects]  # what they have is within its bounds
    order = sorted(screened.best(), key=lambda atom: atom.effect not in taken)
    corrections = [atom.effect for atom in screened.independent(order)]
    sets = [_beside(fit, corrections, free) for fit in rivals]
    other = dataclasses.replace(selection, fits=list(selection.fits))
    compare(shooting, other, sets, selection.best)
    alike = {frozenset(some) for some, _ in sets}
    other.fits = [fit for fit in other.fits if frozenset(fit.effects) in alike or not _is_mixed(fit, free)]
    other.score = dataclasses.replace(other.score, corrected=True)
    first, noise = other.of(sets[0][0]), selection.score.scale * selection.score.a_parameter
    lost = first is None or first.chi2 > rivals[0].chi2 + noise
    if not lost and _only_corrects(other, shooting, selection.needs_more_than(MAX_EFFECTS)):
        selection.fits, selection.score = other.fits, other.score


def _rivals(selection: Selection) -> list[Fit]:
    """The best sets of different names, each with the corrections that it has so far."""
    far = selection.score(selection.best) + _FAR * selection.score.a_parameter
    found: dict[frozenset[tuple[str, str]], Fit] = {}
    for fit in selection.ranked():
        named = frozenset(effect.key for effect in fit.effects if effect.key not in selection.score.free)
        if named and selection.score(fit) < far and len(found) < _MOST:
            found.setdefault(named, fit)
    return list(found.values())


def _beside(fit: Fit, corrections: Sequence[Effect], free: Collection[tuple[str, str]]) -> Set:
    """The names of a set beside some corrections, which begin where they are in it."""
    values = fit.by_effect
    pairs = [(effect, there) for effect, there in values.items() if effect.key not in free]
    taken = {effect.key for effect, _ in pairs} | {(name, e.target) for e, _ in pairs for name in e.covers}
    pairs += [(e, values.get(e, np.zeros(len(e.parameters)))) for e in corrections if e.key not in taken]
    return tuple(effect for effect, _ in pairs), tuple(there for _, there in pairs)


def _is_mixed(fit: Fit, free: Collection[tuple[str, str]]) -> bool:
    """Whether a set holds names beside corrections: it is no fair rival then, unless it holds those of all others."""
    return 0 < sum(effect.key in free for effect in fit.effects) < len(fit.effects)


def _only_corrects(selection: Selection, shooting: Shooting, needed: bool) -> bool:
    """Whether the corrections of the best set do no more than undo a tuning; see `only_undoes` for what is needed."""
    best, free = selection.best, selection.score.free
    alone, others = ([e for e in best.effects if (e.key in free) is there] for there in (True, False))
    return bool(alone and others) and is_a_tuning(shooting, selection, alone, others, needed)
