"""Coloured noise: spectrum, variance, independence, and a generator that is restored."""

from __future__ import annotations

import copy
import pickle

import pytest
import torch

from torch_activegp.errors import ConfigurationError
from torch_activegp.planners import ColoredNoise


def draw(num_steps: int, beta: float, count: int = 20_000, seed: int = 0) -> torch.Tensor:
    return ColoredNoise(num_steps, beta, torch.Generator().manual_seed(seed))((count,))


@pytest.mark.parametrize("beta", [0.0, 1.0, 2.0, 3.5])
@pytest.mark.parametrize("num_steps", [64, 65])
def test_power_falls_with_frequency_to_the_beta(num_steps, beta):
    power = torch.fft.rfft(draw(num_steps, beta)).abs().square().mean(0)[1 : (num_steps + 1) // 2]
    frequency = torch.arange(1, len(power) + 1, dtype=torch.float64).log()
    design = torch.stack([frequency, torch.ones_like(frequency)], dim=-1)
    slope = torch.linalg.lstsq(design, power.log().unsqueeze(-1)).solution[0]
    assert slope.item() == pytest.approx(-beta, abs=0.02)


@pytest.mark.parametrize("beta", [0.0, 2.0, 4.0])
@pytest.mark.parametrize("num_steps", [1, 2, 3, 10, 11])
def test_every_step_has_unit_variance_and_zero_mean(num_steps, beta):
    noise = draw(num_steps, beta, count=40_000)
    torch.testing.assert_close(noise.var(0), torch.ones(num_steps, dtype=torch.float64), atol=0.04, rtol=0)
    torch.testing.assert_close(noise.mean(0), torch.zeros(num_steps, dtype=torch.float64), atol=0.03, rtol=0)


def test_white_noise_is_the_generators_own_draw():
    generator = torch.Generator().manual_seed(3)
    expected = torch.randn((7, 10), generator=generator, dtype=torch.float64)
    torch.testing.assert_close(draw(10, 0.0, count=7, seed=3), expected, atol=1e-14, rtol=0)


def test_larger_beta_moves_slower():
    roughness = [draw(20, beta, count=2000).diff(dim=-1).square().mean().item() for beta in (0.0, 1.0, 2.0, 3.0)]
    assert roughness == sorted(roughness, reverse=True)
    assert roughness[0] > 5 * roughness[2]


def test_sequences_are_independent_of_each_other():
    noise = ColoredNoise(8, 2.0, torch.Generator().manual_seed(0))((20_000, 3))
    correlation = torch.corrcoef(noise[:, :, 0].T)
    torch.testing.assert_close(correlation, torch.eye(3, dtype=torch.float64), atol=0.03, rtol=0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("shape", [(), (4,), (2, 5, 3)])
def test_shape_and_type(shape, dtype):
    noise = ColoredNoise(6, 2.0, dtype=dtype)(shape)
    assert noise.shape == (*shape, 6) and noise.dtype == dtype


def test_global_random_state_is_not_touched():
    before = torch.get_rng_state()
    ColoredNoise(6)((3,))
    assert torch.equal(torch.get_rng_state(), before)


@pytest.mark.parametrize("copier", [copy.deepcopy, lambda module: pickle.loads(pickle.dumps(module))])
def test_a_copy_draws_on_as_the_original_and_apart_from_it(copier):
    noise = ColoredNoise(5, generator=torch.Generator().manual_seed(1))
    noise((3,))
    twin = copier(noise)
    first = noise((3,))
    assert torch.equal(twin((3,)), first)


def test_state_dict_restores_the_generator():
    noise, other = ColoredNoise(5, generator=torch.Generator().manual_seed(1)), ColoredNoise(5)
    noise((3,))
    state = noise.state_dict()
    expected = noise((3,))
    other.load_state_dict(state)
    assert torch.equal(other((3,)), expected)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"num_steps": 0}, "`num_steps` must be at least 1, found 0"),
        ({"num_steps": 5, "beta": -1.0}, "`beta` must be finite and not negative, found -1.0"),
        ({"num_steps": 5, "beta": float("nan")}, "`beta` must be finite"),
    ],
)
def test_errors(kwargs, message):
    with pytest.raises(ConfigurationError, match=message):
        ColoredNoise(**kwargs)
