from __future__ import annotations

import math

import pytest
import torch

from torch_activegp.data.noise import _differences, noise_std
from torch_activegp.errors import DataError

TIME = torch.arange(2000, dtype=torch.float64) * 0.01


@pytest.mark.parametrize("sigma", [1e-5, 1e-3, 0.1])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_white_noise_on_a_swing(sigma: float, dtype: torch.dtype, generator: torch.Generator) -> None:
    noise = sigma * torch.randn(2000, generator=generator, dtype=torch.float64)
    assert noise_std((torch.sin(4 * TIME) + noise).to(dtype)) == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize("order", [4, 6, 8])
def test_on_a_steady_clock_it_is_the_plain_difference(order: int, generator: torch.Generator) -> None:
    signal = torch.randn(50, generator=generator, dtype=torch.float64)
    plain = torch.diff(signal, n=order) / math.comb(2 * order, order) ** 0.5
    torch.testing.assert_close(_differences(torch.arange(50.0, dtype=torch.float64), signal, order), plain)


def test_a_jittered_clock_is_no_noise(generator: torch.Generator) -> None:
    time = TIME + 0.004 * torch.rand(2000, generator=generator, dtype=torch.float64)
    noise = 1e-4 * torch.randn(2000, generator=generator, dtype=torch.float64)
    assert noise_std(torch.sin(4 * time) + noise, time) == pytest.approx(1e-4, rel=0.1)
    assert noise_std(torch.sin(4 * time), time) < 1e-12
    assert noise_std(torch.sin(4 * time)) > 1e-3


def test_a_clean_signal_has_none() -> None:
    assert noise_std(torch.sin(4 * TIME)) < 1e-12
    assert noise_std(torch.full((50,), 3.0)) == 0


def test_jumps_do_not_count(generator: torch.Generator) -> None:
    noise = 1e-3 * torch.randn(2000, generator=generator, dtype=torch.float64)
    jumps = torch.zeros(2000, dtype=torch.float64)
    jumps[::100] = 5.0
    assert noise_std(noise + jumps.cumsum(0)) == pytest.approx(1e-3, rel=0.15)


@pytest.mark.parametrize("speed", [0.002, 0.2, 3.0])
def test_a_quantised_signal_has_the_noise_of_its_step(speed: float) -> None:
    step = 0.01
    coarse = torch.round(torch.sin(speed * TIME) / step) * step
    assert step / 12**0.5 <= noise_std(coarse) * 1.001 < 2 * step


@pytest.mark.parametrize("signal", [torch.zeros(8), torch.zeros(3, 20)])
def test_too_little_is_refused(signal: torch.Tensor) -> None:
    with pytest.raises(DataError, match="9 values or more"):
        noise_std(signal)
