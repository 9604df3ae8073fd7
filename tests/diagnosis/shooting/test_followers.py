from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.followers import Followers
from torch_activegp.diagnosis.shooting.following import OtherSteps, StatesAlone
from torch_activegp.diagnosis.shooting.point import Point, chi2_of


@pytest.fixture
def begun(bench):
    """A fit, and the same with one of its segments begun elsewhere: candidate, before, point, residual."""
    fit = bench.fit("viscous_friction", 0.05)
    starts = fit.starts.copy()
    starts[1] += np.array([0.02, 0.3])
    residual = bench.shooting.residuals_from(starts[None], [fit.candidate])[0]
    flat = np.concatenate(fit.values)
    return fit.candidate, Point(flat, fit.starts, fit.per_segment), Point(flat, starts, chi2_of(residual)), residual


def test_other_steps_come_first_and_states_alone_twice_at_a_point(bench, begun) -> None:
    candidate, before, point, residual = begun
    followers = Followers(bench.shooting, before.starts)

    def trial(hopeful: bool = True) -> list[type | None]:
        followers.new_trial()
        found = [
            followers.behind(candidate, point, residual, before, lambda damping: 0.0 * before.starts, hopeful)
            for _ in range(3)
        ]
        return [type(each) if each is not None else None for each in found]

    assert trial(hopeful=False) == [OtherSteps, None, None]
    assert trial() == trial() == [OtherSteps, StatesAlone, None]
    assert trial() == [OtherSteps, None, None]
    followers.new_point()
    assert trial() == [OtherSteps, StatesAlone, None]
    assert followers.behind(candidate, before, residual, before, lambda damping: before.starts, True) is None


def test_a_first_guess_that_is_worse_in_few_segments_is_rescued_once(bench, begun) -> None:
    candidate, before, point, residual = begun
    followers = Followers(bench.shooting, None)
    everywhere = np.full_like(point.per_segment, -2.0)
    assert followers.rescue(candidate, point, residual, everywhere) is None
    assert followers.rescue(candidate, before, residual, before.per_segment) is None
    assert not followers.rescued
    found = followers.rescue(candidate, point, residual, before.per_segment)
    assert isinstance(found, StatesAlone)
    np.testing.assert_array_equal(np.flatnonzero(found.only), [1])
    assert followers.rescue(candidate, point, residual, before.per_segment) is None
