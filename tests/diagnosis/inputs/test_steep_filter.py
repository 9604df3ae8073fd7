from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter


@pytest.mark.parametrize(("corner", "rows"), [(0.4, 1), (0.26, 1), (0.24, 2), (0.1, 5), (0.02, 25)])
def test_noise_is_new_after_half_a_period_of_the_corner(corner: float, rows: int) -> None:
    assert SteepFilter(corner, 1e-3).rows == rows


@pytest.mark.parametrize("order", [2, 4])
def test_it_leaves_what_a_butterworth_filter_forth_and_back_does(order: int) -> None:
    rows = np.random.default_rng(0).normal(size=400)
    there = signal.sosfiltfilt(signal.butter(order, 2 * 0.08, output="sos"), rows)
    np.testing.assert_allclose(SteepFilter(0.08, 1e-3, (order, 2))(rows)[40:-40], there[40:-40], atol=0.01)


def test_run_once_it_takes_as_much_and_shifts_nothing() -> None:
    time = np.arange(500)
    wave, once = np.sin(2 * np.pi * 0.08 * time), SteepFilter(0.08, 1e-3, (3, 1))
    np.testing.assert_allclose(once(wave)[50:-50], np.sqrt(0.5) * wave[50:-50], atol=2e-3)


@pytest.mark.parametrize("rows", [2, 7, 300])
def test_straight_lines_pass_it(rows: int) -> None:
    line = 0.3 + 0.02 * np.arange(rows)
    np.testing.assert_allclose(SteepFilter(0.05, 1e-3, (2, 2))(line), line, atol=1e-9)
