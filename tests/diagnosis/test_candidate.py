from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.candidate import NOMINAL, Candidate, grouped


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
