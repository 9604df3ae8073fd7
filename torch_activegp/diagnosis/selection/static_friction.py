"""A static friction that recordings of a joint which is hardly ever slow do not show."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.compared import Effort, Selection, compare
from torch_activegp.diagnosis.selection.proposals import Set, contains, paired
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.friction import StribeckFriction


def try_static_friction(shooting: Shooting, selection: Selection, effects: Sequence[Effect]) -> None:
    """Compares the best set with one that has a static friction on top of a dry one, which only slow motion shows.

    Stribeck's friction falls to Coulomb's at some speed. Where a joint is hardly ever so slow, a fit of it ends at
    none, and Coulomb's would be named as if the recordings told: most wrong names of the proof were these. A usual
    static friction, narrower or wider, is held here. Where either leaves no more,
    :func:`~torch_activegp.diagnosis.selection.ties.as_part` says that both laws do; where it leaves less, its law is
    fitted from there: a fit from none stayed there on a striker that stuck in between, 44 in chi2 worse.

    Args:
        shooting: the likelihood.
        selection: takes the held fits in apart, and those that go on from them.
        effects: what is tried.
    """
    best, selection.held = selection.best, ()
    sets = _with_static_friction(list(best.by_effect.items()), effects) if best.effects and not best.at_rest else []
    if not sets:
        return
    held = shooting.fit(sets, best.starts, hold=True, near=best)
    selection.held = [fit for fit in held if np.isfinite(fit.chi2)]
    better = [some for some, fit in zip(sets, held, strict=True) if fit.chi2 < best.chi2]
    compare(shooting, selection, better, best, Effort(race=True))


def _with_static_friction(pairs: Sequence[tuple[Effect, Array]], effects: Sequence[Effect]) -> list[Set]:
    """A set with Stribeck's law, at values that are usual, in place of each Coulomb friction in turn; bristles stay."""
    return [
        paired([*(pair for pair in pairs if pair[0] is not effect), (law, _beside(usual, law, effect, values))])
        for effect, values in pairs
        if (law := _stribeck(effect, effects)) is not None
        for usual in law.usual(float(values[0]))
    ]


def _beside(usual: Array, law: StribeckFriction, effect: Effect, values: Array) -> Array:
    """The usual parameters of a law, and those of its bristles, where it has any, of the friction that it replaces."""
    return np.concatenate([usual, law.taking_over(effect, values)[len(usual) :]])


def _stribeck(effect: Effect, effects: Sequence[Effect]) -> StribeckFriction | None:
    """Stribeck's law in the form of a Coulomb friction, or the firm one; None for what is no Coulomb friction."""
    laws = [law for law in effects if isinstance(law, StribeckFriction) and contains(law, effect)]
    alike = (law for form in (effect.variant, "") for law in laws if law.variant == form)
    return next(alike, None)
