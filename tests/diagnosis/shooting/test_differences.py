from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.shooting.differences import Differences


def test_only_what_is_not_known_is_moved(bench) -> None:
    effects = (bench.effect("viscous_friction"), bench.effect("hysteresis"))
    flat, states = np.array([0.1, 2.0, 0.3]), np.array([1e-3, 1e-2])
    known = {1: np.full((1, 4), 7.0)}
    differences = Differences.of(effects, flat, states, known)
    candidates, starts = differences.candidates(effects, flat, np.zeros((1, 2)))
    np.testing.assert_array_equal(starts[:, 0], [[0, 0], [1e-3, 0], [0, 1e-2], [0, 0], [0, 0]])
    moved = np.array([np.concatenate(c.values) for c in candidates]) - flat
    assert np.argwhere(moved).tolist() == [[3, 0], [4, 2]]
    assert len(Differences.of(effects, flat, states, None).places) == 0


def test_derivatives_of_a_linear_residual_are_exact(bench) -> None:
    effects = (bench.effect("viscous_friction"), bench.effect("hysteresis"))
    rng = np.random.default_rng(0)
    by_state, by_parameter = rng.normal(size=(1, 6, 2)), rng.normal(size=(1, 6, 3))
    flat, begin = np.array([0.1, 2.0, 0.3]), np.array([[0.4, -1.0]])
    differences = Differences.of(effects, flat, np.array([1e-3, 1e-3]), {1: by_parameter[..., 1]})
    candidates, starts = differences.candidates(effects, flat, begin)
    parameters = np.array([np.concatenate(c.values) for c in candidates])
    white = -np.einsum("smn,ksn->ksm", by_state, starts) - np.einsum("smp,kp->ksm", by_parameter, parameters)
    np.testing.assert_allclose(differences.by_states(white), by_state, rtol=1e-9)
    np.testing.assert_allclose(differences.by_parameters(white, {1: by_parameter[..., 1]}), by_parameter, rtol=1e-9)
    assert Differences(np.zeros(0)).by_parameters(white[:1], {}).shape == (1, 6, 0)
