from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.brakes import Brakes
from torch_activegp.diagnosis.elimination import eliminate


def test_a_few_that_got_worse_are_braked_until_they_stand() -> None:
    brakes, worse = Brakes(5), np.arange(5) == 2
    for share in (0.3, 0.09, 0.027, 0.0081):
        np.testing.assert_array_equal(brakes.blame(worse), worse)
        np.testing.assert_allclose(brakes.share, np.where(worse, share, 1.0))
    assert brakes.blame(worse) is None
    np.testing.assert_array_equal(brakes.on, worse)


@pytest.mark.parametrize("count", [0, 2, 4])
def test_none_and_half_of_all_are_not_to_blame(count: int) -> None:
    brakes = Brakes(4)
    assert brakes.blame(np.arange(4) < count) is None
    assert not brakes.on.any()


def test_what_gets_better_is_released_step_by_step_and_what_was_not_tried_stays() -> None:
    brakes, both = Brakes(2), np.array([True, True])
    assert not brakes.follow(np.array([False, True]), both)
    np.testing.assert_allclose(brakes.share, [0.3, 1.0])
    np.testing.assert_array_equal(brakes.on, [True, False])
    assert brakes.follow(both, both)
    np.testing.assert_allclose(brakes.share, [0.6, 1.0])
    brakes.follow(np.array([True, False]), np.array([True, False]))
    np.testing.assert_allclose(brakes.share, [1.0, 1.0])


def test_all_that_did_not_help_hardly_move_after_three_rounds() -> None:
    brakes, tried = Brakes(3), np.array([True, True, False])
    halted = [brakes.follow(np.array([False, True, False]), tried) for _ in range(3)]
    assert halted == [False, False, True]


def test_what_has_nothing_to_gain_or_is_held_does_not_move() -> None:
    brakes, chi2 = Brakes(4), np.array([100.0, 100.0, 100.0, 1e30])
    brakes.share[1] = 1e-6
    promise = np.array([50.0, 50.0, 1e-4, 0.0])
    residual = np.sqrt(promise)[:, None]
    linear = eliminate(np.ones((4, 1, 1)), np.zeros((4, 1, 0)), residual)
    np.testing.assert_allclose(linear.promised(np.array([1.0, 0.5, 0.0, 1.0])), [50.0, 37.5, 0.0, 0.0])
    np.testing.assert_array_equal(brakes.moving(linear, chi2), [True, False, False, False])
    assert brakes.moving(eliminate(np.ones((4, 1, 1)), np.zeros((4, 1, 0)), 0.0 * residual), chi2).all()
