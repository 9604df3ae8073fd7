from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.dropped_rows import bridged, filled


@pytest.fixture(scope="module")
def recorded() -> np.ndarray:
    """Of 400 rows one in eight was dropped, never the first or the last, twice two at once."""
    kept = np.random.default_rng(3).random(400) > 0.12
    kept[[0, -1]], kept[100:102], kept[200:202] = True, False, False
    return kept


def test_a_step_of_several_is_several_rows_and_jitter_is_none() -> None:
    recorded, clock = filled(np.array([0.0, 0.1, 0.2, 0.5, 0.6, 0.74, 0.84]))
    assert recorded.tolist() == [True, True, True, False, False, True, True, True, True]
    np.testing.assert_allclose(clock, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.74, 0.84])


def test_smooth_commands_are_continued_through_the_gaps(recorded) -> None:
    t = np.arange(400) / 100
    truth = np.stack([np.sin(7 * t), np.cos(4 * t) + t], axis=1)
    np.testing.assert_allclose(bridged(truth[recorded], recorded), truth, atol=1e-3)


def test_commands_that_jump_now_and_then_are_met_halfway_at_a_jump_alone(recorded) -> None:
    steps = np.repeat(np.random.default_rng(0).normal(size=40), 10)[:, None]
    bridge, index = bridged(steps[recorded], recorded)[:, 0], np.arange(400)
    rows = np.flatnonzero(recorded)
    before = steps[rows[np.searchsorted(rows, index, "right") - 1], 0]
    after = steps[rows[np.searchsorted(rows, index)], 0]
    still = before == after
    np.testing.assert_array_equal(bridge[still], before[still])
    held = np.sum((before - steps[:, 0]) ** 2)
    assert np.sum((bridge - steps[:, 0]) ** 2) < 0.7 * held


def test_noisy_commands_are_met_by_a_line(recorded) -> None:
    rng = np.random.default_rng(1)
    truth = (np.sin(np.arange(400) / 20) + 0.3 * rng.normal(size=400))[:, None]
    gaps = ~recorded
    line = np.interp(np.arange(400), np.flatnonzero(recorded), truth[recorded, 0])
    np.testing.assert_allclose(bridged(truth[recorded], recorded)[gaps, 0], line[gaps])


def test_nothing_is_made_up_beyond_what_was_commanded(recorded) -> None:
    truth = np.sign(np.sin(np.arange(400) / 9.0))[:, None]
    assert np.abs(bridged(truth[recorded], recorded)).max() <= 1.0


def test_whole_recordings_and_short_ones_are_left_alone() -> None:
    inputs = np.random.default_rng(2).normal(size=(30, 2))
    np.testing.assert_array_equal(bridged(inputs, np.ones(30, bool)), inputs)
    few = np.array([True, True, False, True, True])
    np.testing.assert_array_equal(bridged(inputs[:4], few)[2], inputs[1])
