"""Frictions that hardly differ between the directions are one law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.merging import TWO_SIDED
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.effect import Effect

_ALIKE = 0.1
"""Part of what is added to a friction by which the directions must differ; true ones differed by 0.36 at least. On a
machine that strikes, contacts by other numerics made 0.234 and 0.225 N s/m of 0.231, and that gained 107 in chi2."""


def with_one_law(shooting: Shooting, selection: Selection, effects: Sequence[Effect]) -> Selection:
    """The sets without frictions whose directions hardly differ, where the best one holds such.

    What gains by less is no name. The same set with the law of one number in its place is fitted, if it was not.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
        effects: what was tried.
    """
    best = selection.best
    alike = [effect for effect in best.effects if _is_alike(best, effect)]
    if not alike:
        return selection
    law, values = alike[0], best.by_effect
    simple = next((effect for effect in effects if _is_simpler(effect, law)), None)
    if simple is None:
        return selection
    others = [effect for effect in best.effects if effect is not law]
    if selection.of([simple, *others]) is None:
        level = np.array([values[law].mean()])
        sets = [([simple, *others], [level, *(values[effect] for effect in others)])]
        selection.add(shooting.fit(sets, best.starts, near=best, below=selection.nominal))
    return with_one_law(shooting, selection.without(law.key, shooting.dof), effects)


def _is_alike(fit: Fit, effect: Effect) -> bool:
    """Whether a friction of a set is about as large in both directions."""
    values = fit.by_effect[effect]
    return effect.name == TWO_SIDED and bool(np.ptp(values) < _ALIKE * np.abs(values).mean())


def _is_simpler(effect: Effect, law: Effect) -> bool:
    """Whether an effect is a law's own form of one number, at the same place."""
    return effect.target == law.target and effect.name in law.covers and len(effect.parameters) == 1
