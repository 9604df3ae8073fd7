from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.smoothing import follow, smooth

TIME = np.arange(400) * 0.01
SIGMA = 1e-3


@pytest.fixture
def noise() -> np.ndarray:
    return SIGMA * np.random.default_rng(0).standard_normal(400)


@pytest.mark.parametrize("way", [smooth, follow])
def test_slope_and_value_are_those_of_the_motion(way, noise) -> None:
    slope, value = way(TIME, np.sin(3 * TIME) + noise, SIGMA)
    inner = slice(20, -20)
    assert np.abs(slope - 3 * np.cos(3 * TIME))[inner].max() < 0.1
    assert np.sqrt(np.mean((value - np.sin(3 * TIME))[inner] ** 2)) < 0.7 * SIGMA


def test_fast_motion_is_followed(noise) -> None:
    motion = 0.3 * np.sin(12 * TIME)
    bias = [np.abs(way(TIME, motion + noise, SIGMA)[1] - motion)[20:-20].mean() for way in (smooth, follow)]
    assert max(bias) < SIGMA


@pytest.mark.parametrize("way", [smooth, follow])
def test_a_dozen_rows_are_enough(way) -> None:
    slope, value = way(TIME[:12], 2.0 * TIME[:12], SIGMA)
    assert slope == pytest.approx(np.full(12, 2.0))
    assert value == pytest.approx(2.0 * TIME[:12])
