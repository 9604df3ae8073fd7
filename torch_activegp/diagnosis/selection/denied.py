"""Names that explain next to nothing, and that some recordings deny."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.selection.compared import Selection, fitted
from torch_activegp.diagnosis.selection.development import simplify
from torch_activegp.diagnosis.selection.prospects import MAX_EFFECTS
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import MATERIAL
from torch_activegp.physics.effect import Effect

_LESS = 0.7
"""Part of what a run leaves with a name that it leaves without, to deny that name."""
_WORK = 5e6
"""Time steps for what is simpler than what is left."""


def without_denied(shooting: Shooting, selection: Selection, effects: Sequence[Effect]) -> Selection:
    """The sets without names that explain less than is worth one, and without which some run leaves less.

    Where all that was found leaves much more than noise a name may be worth a part of what is left, however little that
    is of the mismatch; but then it may be a compromise among errors of another kind. On a drive that ran away without
    friction, recorded behind a cogging, an encoder's gain of 1.027 explained 0.3 % of the mismatch and a third of what
    was left, and a run left 55 % without it of what it left with it. The dry friction that was there explained as much,
    and no run left less than 88 % without it.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
        effects: what was tried.
    """
    for _ in range(MAX_EFFECTS):
        best = selection.best
        if not selection.score.inadequate or len(best.effects) < 2:
            break
        rests = [(effect, _without(shooting, selection, effect)) for effect in best.effects]
        denied = [(effect, rest) for effect, rest in rests if _denies(shooting, selection, rest)]
        if not denied:
            break
        effect, rest = min(denied, key=lambda pair: pair[1].chi2)
        selection = selection.without(effect.key, shooting.dof)
        selection.add([rest])
        simplify(selection, shooting, effects, shooting.work + _WORK)
    return selection


def _without(shooting: Shooting, selection: Selection, effect: Effect) -> Fit:
    """The best set without one of its effects."""
    return fitted(shooting, selection, [other for other in selection.best.effects if other is not effect])


def _denies(shooting: Shooting, selection: Selection, rest: Fit) -> bool:
    """Whether some run leaves less by a part of the best set, which explains nearly as much of the mismatch."""
    best, nominal = selection.best, selection.nominal
    if not rest.chi2 - best.chi2 < MATERIAL * (nominal.chi2 - best.chi2):
        return False
    run = shooting.segments.run
    left = [np.bincount(run, weights=fit.per_segment) for fit in (rest, best)]
    return bool((left[0] < _LESS * left[1]).any())
