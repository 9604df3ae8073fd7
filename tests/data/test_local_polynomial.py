from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.signal import savgol_filter

from torch_activegp.data.local_polynomial import local_motion, local_slope
from torch_activegp.errors import ConfigurationError


def clock(jitter: float, generator: torch.Generator, rows: int = 60) -> torch.Tensor:
    return 0.01 * (torch.arange(rows) + jitter * torch.rand(rows, generator=generator, dtype=torch.float64))


@pytest.mark.parametrize("jitter", [0.0, 0.4])
@pytest.mark.parametrize("window", [5, 13, 59])
def test_the_slope_of_a_cubic_is_exact_at_every_row(jitter: float, window: int, generator: torch.Generator) -> None:
    time = clock(jitter, generator)
    values = 1 - 2 * time + 5 * time**2 - 7 * time**3
    torch.testing.assert_close(local_slope(time, values, window), -2 + 10 * time - 21 * time**2, rtol=1e-7, atol=1e-7)


def test_a_nearly_regular_clock_gives_nearly_the_filter_of_savitzky_and_golay(generator: torch.Generator) -> None:
    time = clock(0.004, generator, rows=5000)  # too irregular for the filter, and longer than one chunk
    values = torch.randn(5000, generator=generator, dtype=torch.float64)
    expected = savgol_filter(values.numpy(), 25, 3, deriv=1, delta=0.01)
    assert np.abs(local_slope(time, values, 25).numpy() - expected).max() < 0.01 * np.abs(expected).max()


def test_each_row_is_an_ordinary_least_squares_fit(generator: torch.Generator) -> None:
    time = clock(0.8, generator)
    values = torch.randn(60, generator=generator, dtype=torch.float64)
    slope = local_slope(time, values, 9)
    for row, start in [(0, 0), (3, 0), (4, 0), (30, 26), (55, 51), (57, 51), (59, 51)]:
        t = time[start : start + 9].numpy()
        fit = np.polynomial.Polynomial.fit(t, values[start : start + 9].numpy(), 3).deriv()
        assert slope[row].item() == pytest.approx(fit(time[row].item()), rel=1e-8)


@pytest.mark.parametrize("pause", [0.1, 10.0, 1e4])
def test_a_pause_in_a_window_costs_no_digits(pause: float, generator: torch.Generator) -> None:
    time = clock(0.4, generator)
    time[30:] += pause
    values = torch.randn(60, generator=generator, dtype=torch.float64)
    value, slope = local_motion(time, values, 9, 3)
    for row, start in [(10, 6), (28, 24), (29, 25), (32, 28), (57, 51)]:
        t = time[start : start + 9].numpy()
        fit = np.polynomial.Polynomial.fit(t, values[start : start + 9].numpy(), 3)
        assert value[row].item() == pytest.approx(fit(time[row].item()), rel=1e-6, abs=1e-6)
        assert slope[row].item() == pytest.approx(fit.deriv()(time[row].item()), rel=1e-5, abs=1e-6)


@pytest.mark.parametrize("jitter", [0.0, 0.4])
def test_a_higher_degree_follows_more_and_averages_noise(jitter: float, generator: torch.Generator) -> None:
    time = clock(jitter, generator)
    exact = 1 - 2 * time + 5 * time**2 - 7 * time**5
    value, slope = local_motion(time, exact, 25, 5)
    torch.testing.assert_close(value, exact, rtol=0, atol=1e-9)
    torch.testing.assert_close(slope, -2 + 10 * time - 35 * time**4, rtol=0, atol=1e-6)
    noise = torch.randn(60, generator=generator, dtype=torch.float64)
    assert local_motion(time, noise, 25, 5)[0][12:-12].std() < 0.6 * noise.std()


@pytest.mark.parametrize("window", [3, 6, 61])
def test_an_impossible_window_is_refused(window: int, generator: torch.Generator) -> None:
    with pytest.raises(ConfigurationError, match=f"odd number from 5 to 60 rows wanted, found {window}"):
        local_slope(clock(0, generator), clock(0, generator), window)


def test_the_same_signal_gives_the_same_bits(generator: torch.Generator) -> None:
    """Whatever the memory held before that the solver works in."""
    time = torch.arange(300).double() * 0.01 + 0.004 * torch.rand(300, generator=generator, dtype=torch.double)
    values = torch.randn(300, generator=generator, dtype=torch.double)
    first = local_slope(time, values, 13)
    for left in range(1, 60):
        scrap = [torch.full((size,), left % 7, dtype=torch.int32) for size in (1, 2, 4, 8, 16, 32)]
        del scrap
        assert torch.equal(local_slope(time, values, 13), first)
