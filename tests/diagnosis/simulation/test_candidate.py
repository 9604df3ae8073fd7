from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate, grouped


def test_grouped_gives_each_effect_once_with_its_candidates_and_values(bench) -> None:
    damping, load = bench.effect("viscous_friction"), bench.effect("gravity_error", "world")
    candidates = [
        NOMINAL,
        Candidate((damping,), (np.array([0.1]),)),
        Candidate((load, damping), (np.array([0.3]), np.array([0.2]))),
    ]
    found = {effect: (which.tolist(), values.tolist()) for effect, which, values in grouped(candidates)}
    assert found == {damping: ([1, 2], [[0.1], [0.2]]), load: ([2], [[0.3]])}


def test_grouped_refuses_an_effect_without_values(bench) -> None:
    with pytest.raises(ValueError, match="shorter"):
        list(grouped([Candidate((bench.effect("viscous_friction"),), ())]))


def test_a_candidate_on_some_of_the_segments(bench) -> None:
    force = np.arange(24.0).reshape(4, 6, 1)
    which = np.array([True, False, False, True])
    picked = Candidate((bench.effect("viscous_friction"),), (np.array([0.1]),), force=force).pick(which)
    assert picked.effects and picked.force is not None
    np.testing.assert_array_equal(picked.force, force[[0, 3]])
    assert picked.shove is None
    assert NOMINAL.pick(which) is NOMINAL
