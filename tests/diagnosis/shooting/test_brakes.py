from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.shooting.brakes import Brakes
from torch_activegp.diagnosis.shooting.elimination import eliminate
from torch_activegp.diagnosis.shooting.following import SLOWER


def test_a_segment_is_braked_as_the_way_that_its_states_take() -> None:
    """The whole step and the smoothed recording, which comes last, brake nothing; nor do they release."""
    brakes, last = Brakes(4), len(SLOWER) + 1
    brakes.take(np.array([0, 1, 3, last]))
    np.testing.assert_array_equal(brakes.damping, [0.0, SLOWER[0], SLOWER[2], 0.0])
    np.testing.assert_array_equal(brakes.on, [False, True, True, False])
    brakes.take(np.array([0, 2, 0, 0]))
    np.testing.assert_array_equal(brakes.damping, [0.0, SLOWER[1], SLOWER[2], 0.0])


def test_what_gets_better_is_released_step_by_step_and_what_was_not_tried_stays() -> None:
    brakes, both = Brakes(2), np.array([True, True])
    assert not brakes.follow(np.array([False, True]), both)
    np.testing.assert_allclose(brakes.damping, [1e-3, 0.0])
    brakes.follow(np.array([False, False]), np.array([True, False]))
    np.testing.assert_allclose(brakes.damping, [3e-2, 0.0])
    assert brakes.follow(both, both)
    np.testing.assert_allclose(brakes.damping, [1e-3, 0.0])
    brakes.follow(both, both)
    assert not brakes.on.any()


def test_all_that_did_not_help_hardly_move_after_four_rounds() -> None:
    brakes, tried = Brakes(3), np.array([True, True, False])
    halted = [brakes.follow(np.array([False, True, False]), tried) for _ in range(4)]
    assert halted == [False, False, False, True]


def test_what_has_nothing_to_gain_does_not_move() -> None:
    brakes, chi2 = Brakes(3), np.array([100.0, 100.0, 1e30])
    residual = np.sqrt(np.array([50.0, 1e-4, 0.0]))[:, None]
    linear = eliminate(np.ones((3, 1, 1)), np.zeros((3, 1, 0)), residual)
    whole = linear.states(np.zeros(0), np.full(1, 1e9))
    np.testing.assert_allclose(linear.promised(whole), [50.0, 1e-4, 0.0])
    np.testing.assert_array_equal(brakes.moving(linear, whole, chi2), [True, False, False])
    assert brakes.moving(linear, 0.0 * whole, chi2).all()
