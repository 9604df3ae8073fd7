from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.compared import Selection
from torch_activegp.diagnosis.score import Score
from torch_activegp.diagnosis.stand_ins import soften, swap, try_tuned


def test_rivals_take_the_place_of_what_was_found(bench) -> None:
    selection = Selection(bench.nominal, [bench.nominal, bench.fit("quadratic_drag", 0.05)], Score(400, 60, 1.0))
    selection.rescale(bench.shooting.dof)
    swap(selection, bench.shooting, [bench.effect("quadratic_drag"), bench.effect("viscous_friction")])
    assert selection.best.keys == {("viscous_friction", "joint:hip")}


def test_dry_friction_that_looks_promising_is_fitted_in_its_soft_form(bench) -> None:
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 60, 1.0))
    soften(selection, bench.shooting, bench.effects)
    (fit,) = selection.fits[1:]
    assert [(e.name, e.variant) for e in fit.effects] == [("coulomb_friction", "soft")]
    assert fit.chi2 < bench.nominal.chi2
    explained = Selection(bench.nominal, [bench.nominal, bench.fit("viscous_friction", 0.05), fit], selection.score)
    soften(explained, bench.shooting, bench.effects)
    assert len(explained.fits) == 3


@pytest.mark.parametrize("optimum", [True, False])
def test_a_name_that_stands_for_a_tuning_is_tried_beside_all_that_is_tunable(bench, monkeypatch, optimum: bool) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.stand_ins.at_an_optimum", lambda *_: optimum)
    spring, load = bench.effect("cubic_spring"), bench.effect("payload_mass", "body:rod")
    fits = bench.shooting.fit([((spring, load), (np.array([0.1]), np.array([0.07])))], bench.nominal.starts)
    selection = Selection(bench.nominal, [bench.nominal, *fits], Score(bench.shooting.samples, 60, 1.0))
    try_tuned(selection, bench.shooting, bench.effects)
    damping = ("viscous_friction", "joint:hip")
    tried = [fit.keys for fit in selection.fits if damping in fit.keys]
    assert any(spring.key in keys and load.key not in keys for keys in tried) == optimum
    assert any(load.key in keys and spring.key not in keys for keys in tried) == optimum
    alone = Selection(bench.nominal, [bench.nominal, bench.fit("cubic_spring", 0.1)], selection.score)
    try_tuned(alone, bench.shooting, bench.effects)
    assert len(alone.fits) == 2
