"""Settings of the candidates: population, bounds, ranges."""

from __future__ import annotations

import pytest
import torch
from torchrl.data import Bounded, Categorical, Unbounded

from torch_activegp.errors import ConfigurationError
from torch_activegp.planners import Sampling


@pytest.mark.parametrize(
    ("decay", "num_candidates", "top_k", "expected"),
    [
        (1.25, 50, 10, (50, 40, 32, 25, 20, 20, 20)),
        (1.0, 50, 10, (50,) * 7),
        (2.0, 64, 1, (64, 32, 16, 8, 4, 2, 2)),
        (1.25, 15, 10, (15,) * 7),
    ],
)
def test_population_decays_to_twice_the_elites_and_never_grows(decay, num_candidates, top_k, expected):
    assert Sampling(decay=decay).population(num_candidates, top_k, 7) == expected


def test_bounds_are_those_of_the_spec():
    low, high = Sampling().bounds(Bounded(torch.tensor([-1.0, 0.0]), torch.tensor([1.0, 3.0])))
    assert low.tolist() == [-1.0, 0.0] and high.tolist() == [1.0, 3.0] and low.dtype == torch.float32


def test_own_bounds_tighten_those_of_the_spec_and_never_widen_them():
    low, high = Sampling(action_low=[-9.0, 0.5], action_high=2.0).bounds(
        Bounded(torch.tensor([-1.0, 0.0]), torch.tensor([1.0, 3.0]))
    )
    assert low.tolist() == [-1.0, 0.5] and high.tolist() == [1.0, 2.0]


def test_own_bounds_make_an_unbounded_spec_usable():
    low, high = Sampling(action_low=-2.0, action_high=[2.0, 3.0]).bounds(Unbounded((2,), dtype=torch.float64))
    assert low.tolist() == [-2.0, -2.0] and high.tolist() == [2.0, 3.0] and high.dtype == torch.float64


@pytest.mark.parametrize(
    ("spec", "kwargs", "message"),
    [
        (Unbounded((2,)), {}, r"finite bounds .* Bounded action spec or pass Sampling\(action_low"),
        (Unbounded((2,)), {"action_low": -1.0}, "finite bounds"),
        (Bounded(-1, 1, (2,), dtype=torch.float32), {"action_low": 1.0}, "low < high for every action"),
        (Bounded(-1, 1, (2,), dtype=torch.float32), {"action_low": [0.0, 0.0, 0.0]}, r"each of the 2 actions.*\(3,\)"),
        (Bounded(-1, 1, (2, 3), dtype=torch.float32), {}, r"one vector of real actions.*\(2, 3\)"),
        (Categorical(4), {}, "one vector of real actions.*Categorical"),
        (Bounded(0, 5, (2,), dtype=torch.int64), {}, "one vector of real actions.*int64"),
    ],
)
def test_bounds_that_cannot_be_sampled(spec, kwargs, message):
    with pytest.raises(ConfigurationError, match=message):
        Sampling(**kwargs).bounds(spec)


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"noise_beta": -1.0}, "`noise_beta` must be finite and not negative, found -1.0"),
        ({"decay": 0.9}, "`decay` must be finite and at least 1"),
        ({"momentum": 1.0}, r"`momentum` must be in \[0, 1\), found 1.0"),
        ({"init_std": 0.0}, "`init_std` must be finite and positive"),
        ({"init_std": float("nan")}, "`init_std` must be finite and positive"),
    ],
)
def test_values_out_of_range(kwargs, message):
    with pytest.raises(ConfigurationError, match=message):
        Sampling(**kwargs)
