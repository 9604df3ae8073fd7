from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.prospects import is_alike
from torch_activegp.diagnosis.shooting.score import Score


@pytest.mark.parametrize(
    ("free", "others", "developed"),
    [
        (True, ("constant_force",), True),  # another push beside the same name: both undo a tuning
        (True, (), False),  # nothing is undone here
        (False, ("constant_force",), False),  # both are names
        (True, ("constant_force", "quadratic_drag"), False),  # one more name
    ],
)
def test_sets_with_the_same_names_that_undo_a_tuning_in_other_ways_are_developed_once(
    bench, free, others, developed
) -> None:
    def of(*names: str, chi2: float):
        effects = tuple(bench.effect(*name.split("@")) for name in names)
        return dataclasses.replace(bench.nominal, effects=effects, values=(np.array([0.1]),) * len(names), chi2=chi2)

    tunable = frozenset(effect.key for effect in bench.effects if effect.tunable) if free else frozenset()
    best = of("coulomb_friction", "actuator_bias@actuator:drive", chi2=2000.0)
    fit = of("coulomb_friction", *others, chi2=2100.0)
    score = Score(bench.shooting.samples, 60, 5.0, free=tunable)
    chosen = Selection(bench.nominal, [bench.nominal, best, fit], score)
    assert chosen.best is best
    assert is_alike(chosen, fit, {frozenset(best.effects)}) == developed
    assert not is_alike(chosen, fit, set())
    assert not is_alike(chosen, best, {frozenset(fit.effects)})
    close = dataclasses.replace(fit, chi2=best.chi2 + 50.0)
    assert score.cheapest * score.scale == pytest.approx(75.0, abs=15.0)
    near = Selection(bench.nominal, [bench.nominal, best, close], score)
    assert is_alike(near, best, {frozenset(close.effects)}) == developed
