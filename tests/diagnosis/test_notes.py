from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.compared import Selection
from torch_activegp.diagnosis.explain import Explanation
from torch_activegp.diagnosis.notes import search_notes
from torch_activegp.diagnosis.score import Score


def test_nothing_is_said_of_a_search_as_it_should_be_and_all_that_is_not(bench) -> None:
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 5, 1.0))
    plain = Explanation(bench.engine, bench.shooting, selection, (), fine=False)
    assert search_notes(plain) == []
    some = bench.shooting.pick(np.arange(0, bench.segments.size, 2))
    short = dataclasses.replace(selection, cut_short=True)
    numerics, part, end = search_notes(Explanation(bench.engine, some, short, (), fine=True, firm=True))
    assert f"{bench.engine.model.opt.timestep:g} s" in numerics
    assert "by Runge-Kutta in steps of 0.005 s than" in numerics
    assert "sticks firmly" in numerics
    assert "47% of the recordings" in part
    assert "15 million time steps" in end
