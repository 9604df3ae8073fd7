"""Chance as a score: uniform, its own generator, resumable."""

from __future__ import annotations

import torch
from tensordict import TensorDict

from torch_activegp.acquisition import RandomScore


def score(seed: int = 0) -> RandomScore:
    return RandomScore(torch.Generator().manual_seed(seed))


def test_it_is_uniform_and_knows_nothing_of_the_point() -> None:
    values = score().evaluate(torch.zeros(20000, 2, dtype=torch.float64))
    assert 0.0 <= values.min()
    assert values.max() < 1.0
    assert abs(values.mean().item() - 0.5) < 0.01
    assert abs(values.var().item() - 1 / 12) < 0.003
    assert torch.equal(values[:50], score().evaluate(torch.full((50, 5), torch.nan, dtype=torch.float64)))


def test_the_seed_decides_and_global_chance_is_left_alone() -> None:
    points = torch.zeros(9, 2)
    before = torch.get_rng_state()
    first, same, other = score(1).evaluate(points), score(1).evaluate(points), score(2).evaluate(points)
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.equal(first, same)
    assert not torch.equal(first, other)


def test_a_restored_score_draws_the_same_numbers() -> None:
    first, second, points = score(1), score(2), TensorDict({"loc": torch.zeros(9, 2)}, [9])
    first(points)
    second.load_state_dict(first.state_dict())
    assert torch.equal(first(points.clone())["random"], second(points.clone())["random"])
