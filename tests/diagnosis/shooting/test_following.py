from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.following import SLOWER, OtherSteps, StatesAlone
from torch_activegp.diagnosis.shooting.point import Point, chi2_of


@pytest.fixture
def astray(bench):
    """The right friction with two segments begun elsewhere: trial, point, residual, and which segments these are."""
    fit = bench.fit("viscous_friction", 0.05)
    starts, only = fit.starts.copy(), np.isin(np.arange(bench.segments.size), [1, 4])
    starts[only] += np.array([0.02, 0.3])
    residual = bench.shooting.residuals_from(starts[None], [fit.candidate])[0]
    return fit, Point(np.concatenate(fit.values), starts, chi2_of(residual)), residual, only


def test_each_segment_takes_the_best_of_several_steps_and_the_others_stay(bench, astray) -> None:
    fit, point, residual, only = astray
    follower = OtherSteps(fit.candidate, point, residual, only, [point.starts + 1.0, fit.starts, point.starts - 1.0])
    candidates, states = follower.ask()
    follower.tell(bench.shooting.residuals_from(states, candidates))
    assert follower.ends
    np.testing.assert_array_equal(follower.chosen, np.where(only, 2, 0))
    np.testing.assert_array_equal(follower.point.starts, np.where(only[:, None], fit.starts, point.starts))
    np.testing.assert_allclose(follower.point.per_segment, chi2_of(follower.residual))
    assert follower.point.chi2 < point.chi2


def test_states_alone_find_back(bench, astray) -> None:
    """By derivatives of their own and several steps side by side, for the segments in question alone."""
    fit, point, residual, only = astray
    follower, counts = StatesAlone(bench.shooting, fit.candidate, point, residual, only), []
    while not follower.ends:
        candidates, states = follower.ask()
        counts.append(len(candidates))
        follower.tell(bench.shooting.residuals_from(states, candidates))
        assert len(counts) < 10
    assert counts[:2] == [point.starts.shape[1], 1 + len(SLOWER)]
    assert follower.point.chi2 == pytest.approx(fit.chi2, abs=1.0)
    np.testing.assert_array_equal(follower.point.starts[~only], point.starts[~only])
