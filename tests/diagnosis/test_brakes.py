from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.brakes import Brakes


def test_a_few_that_got_worse_are_braked_until_they_stand() -> None:
    brakes, worse = Brakes(5), np.arange(5) == 2
    for share in (0.3, 0.09, 0.027, 0.0081):
        np.testing.assert_array_equal(brakes.blame(worse), worse)
        np.testing.assert_allclose(brakes.share, np.where(worse, share, 1.0))
    assert brakes.blame(worse) is None
    np.testing.assert_array_equal(brakes.on, worse)
    np.testing.assert_array_equal(brakes.halted, worse)


@pytest.mark.parametrize("count", [0, 2, 4])
def test_none_and_half_of_all_are_not_to_blame(count: int) -> None:
    brakes = Brakes(4)
    assert brakes.blame(np.arange(4) < count) is None
    assert not brakes.on.any()


def test_what_gets_better_is_released_step_by_step() -> None:
    brakes = Brakes(2)
    brakes.follow(np.array([False, True]))
    np.testing.assert_allclose(brakes.share, [0.3, 1.0])
    brakes.follow(np.array([True, True]))
    np.testing.assert_allclose(brakes.share, [0.6, 1.0])
    brakes.follow(np.array([True, False]))
    np.testing.assert_allclose(brakes.share, [1.0, 0.3])
