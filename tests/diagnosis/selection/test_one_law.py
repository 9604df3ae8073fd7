from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.one_law import with_one_law
from torch_activegp.diagnosis.shooting.score import Score


@pytest.mark.parametrize("fitted", [True, False])
@pytest.mark.parametrize(("values", "names"), [((-0.06, -0.063), {"viscous_friction"}), ((-0.06, -0.07), None)])
def test_directions_that_differ_by_less_than_a_tenth_are_one_law(bench, fitted: bool, values, names) -> None:
    """What gains more by chance or numerics, too; with another name beside it or without."""
    two, other = bench.fit("asymmetric_friction", 0.06, 0.06), bench.effect("cubic_spring")
    near = dataclasses.replace(two, values=(np.array(values),), chi2=two.chi2 - 200.0)
    plain = [bench.fit("viscous_friction", 0.06)] if fitted else []
    score = Score(bench.shooting.samples, 20, 1.0)
    found = with_one_law(bench.shooting, Selection(bench.nominal, [bench.nominal, near, *plain], score), bench.effects)
    assert {name for name, _ in found.best.keys} == (names or {"asymmetric_friction"})
    if names:
        assert found.best.values[0] == pytest.approx(bench.viscous, rel=0.1)
    both = dataclasses.replace(near, effects=(*near.effects, other), values=(*near.values, np.zeros(1)))
    beside = Selection(bench.nominal, [bench.nominal, dataclasses.replace(both, chi2=near.chi2 - 900.0)], score)
    kept = with_one_law(bench.shooting, beside, bench.effects)
    told = {frozenset(name for name, _ in fit.keys) for fit in kept.fits if fit.effects}
    assert told == {frozenset({*(names or {"asymmetric_friction"}), "cubic_spring"})}


def test_nothing_changes_without_such_a_friction(bench) -> None:
    plain = bench.fit("viscous_friction", 0.06)
    selection = Selection(bench.nominal, [bench.nominal, plain], Score(bench.shooting.samples, 20, 1.0))
    assert with_one_law(bench.shooting, selection, bench.effects) is selection
    two = bench.fit("asymmetric_friction", 0.06, 0.06)
    alone = Selection(bench.nominal, [bench.nominal, two], Score(bench.shooting.samples, 20, 1.0))
    untried = [effect for effect in bench.effects if effect.name != "viscous_friction"]
    assert with_one_law(bench.shooting, alone, untried) is alone
