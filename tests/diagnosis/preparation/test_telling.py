"""How much of the data tells enough, seen by the segments over which sets are compared."""

from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.preparation import telling as module
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.shooting.likelihood import Shooting


def test_of_much_data_that_takes_long_a_part_is_simulated(bench, monkeypatch) -> None:
    made = Numerics.of(bench.integrated("Euler", 0.01), 1)
    sets = [((bench.effect("viscous_friction"),), (np.array([0.05]),))]
    given = bench.segments, bench.shooting.noise, bench.nominal, bench.nominal, sets
    steps = made.coarse.steps_in(bench.segments)
    monkeypatch.setattr(module, "_JUDGES", 1)
    monkeypatch.setattr(module, "_AFFORDED", 0.8 * steps)
    monkeypatch.setattr(module, "_PLENTY", bench.nominal.chi2)
    assert made.choose(*given)[1].segments.size == bench.segments.size  # what is left tells too little
    monkeypatch.setattr(module, "_PLENTY", 1.0)
    _, shooting, nominal, judged = made.choose(*given)
    assert 1 < shooting.segments.size < bench.segments.size
    assert shooting.engine.steps_in(shooting.segments) <= steps
    assert len(nominal.starts) == len(judged.starts) == shooting.segments.size
    assert judged.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
    monkeypatch.setattr(module, "_JUDGES", bench.segments.size)
    assert made.choose(*given)[1].segments.size == bench.segments.size


def test_forms_are_compared_on_what_the_longest_of_them_can_afford(bench, monkeypatch) -> None:
    made = Numerics.of(bench.integrated("Euler", 0.01), 1)
    asked, shares, subset = [], [], Shooting.subset
    monkeypatch.setattr(module, "_JUDGES", 1)
    monkeypatch.setattr(module, "_affordable", lambda engine, segments: asked.append(engine) or 0.2)
    monkeypatch.setattr(
        Shooting, "subset", lambda self, share, *more: shares.append(share) or subset(self, share, *more)
    )
    made.choose(bench.segments, bench.shooting.noise, bench.nominal, bench.nominal)
    assert (asked[0], shares[0]) == (made.fine, 0.2)
    monkeypatch.undo()
    steps = made.fine.steps_in(bench.segments)
    monkeypatch.setattr(module, "_AFFORDED", 0.95 * steps)
    assert module._affordable(made.fine, bench.segments) == max(0.95, 16 / bench.segments.size)
    few = bench.segments.pick(np.zeros(40, dtype=np.int64))
    monkeypatch.setattr(module, "_AFFORDED", 1.0)
    assert module._affordable(made.fine, few) == max(16, 2 * len(few.runs)) / 40


def test_a_form_that_was_found_on_the_same_part_is_not_fitted_again(bench, monkeypatch) -> None:
    made = Numerics.of(bench.integrated("Euler", 0.01), 1)
    sets = [((bench.effect("viscous_friction"),), (np.array([0.05]),))]
    for name, value in (("_JUDGES", 6), ("_AFFORDED", 1.0), ("_PLENTY", 1.0)):
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(Numerics, "_on_all", lambda *_: pytest.fail("fitted again"))
    _, shooting, nominal, judged = made.choose(bench.segments, bench.shooting.noise, bench.nominal, bench.nominal, sets)
    assert shooting.segments.size == len(nominal.starts) == len(judged.starts) == 6
    assert judged.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
