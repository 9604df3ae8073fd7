from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.denied import without_denied
from torch_activegp.diagnosis.shooting.score import Score

MODULE = "torch_activegp.diagnosis.selection.denied"


@pytest.mark.parametrize(
    ("worse", "mismatch", "kept"),
    [(1.6, 1e9, False), (1.2, 1e9, True), (1.6, 1e5, True)],
    ids=["denied", "by little", "explains much"],
)
def test_a_name_that_explains_next_to_nothing_goes_where_a_run_denies_it(
    bench, monkeypatch, worse, mismatch, kept
) -> None:
    """And where much more than noise is left, which it may be a compromise among."""
    simpler = []
    monkeypatch.setattr(f"{MODULE}.simplify", lambda selection, *_: simpler.append(selection))
    wet, push = bench.fit("viscous_friction", 0.05), bench.effect("constant_force")
    first = bench.shooting.segments.run == 0
    part = np.where(first, 20.0, 100.0) * wet.per_segment
    wet = dataclasses.replace(wet, chi2=float(part.sum()), per_segment=part)
    part = np.where(first, worse, 0.05) * wet.per_segment
    more = {"effects": (*wet.effects, push), "values": (*wet.values, np.zeros(1))}
    both = dataclasses.replace(wet, **more, chi2=float(part.sum()), per_segment=part)
    nominal = dataclasses.replace(bench.nominal, chi2=mismatch)
    score = Score(bench.shooting.samples, 5, 50.0, mismatch)
    chosen = Selection(nominal, [nominal, wet, both], score)
    for effect in both.effects:  # nothing is fitted anew
        rest = wet if effect is push else dataclasses.replace(nominal, effects=(push,), values=(np.zeros(1),))
        chosen.parts[frozenset(both.effects), frozenset(rest.effects)] = rest
        chosen.add([rest])
    found = without_denied(bench.shooting, chosen, both.effects)
    assert (found.best.keys == both.keys) == kept
    assert kept or found.best.keys == wet.keys
    assert simpler == ([] if kept else [found])
