from __future__ import annotations

import torch

from torch_activegp.experiments.coverage import farthest_points


def cloud() -> torch.Tensor:
    chance = torch.Generator().manual_seed(0)
    dense = 0.01 * torch.randn(500, 2, generator=chance, dtype=torch.float64)
    wide = torch.rand(60, 2, generator=chance, dtype=torch.float64) * torch.tensor([2.0, 200.0]) - 1.0
    return torch.cat([dense, wide])


def radius(points: torch.Tensor, chosen: torch.Tensor) -> float:
    """The largest distance from a point to its nearest chosen one, in standard deviations."""
    scaled = points / points.std(0)
    return float(torch.cdist(scaled, scaled[chosen]).amin(1).max())


def test_it_covers_better_than_random_points_and_leaves_the_dense_part() -> None:
    points = cloud()
    chosen = farthest_points(points, 30)
    random = torch.randperm(len(points), generator=torch.Generator().manual_seed(1))[:30]
    assert radius(points, chosen) < 0.5 * radius(points, random)
    assert (chosen >= 500).float().mean() > 0.8


def test_indices_are_distinct_sorted_and_the_same_for_the_same_seed() -> None:
    chosen = farthest_points(cloud(), 40, seed=3)
    assert chosen.tolist() == sorted(set(chosen.tolist()))
    assert len(chosen) == 40
    assert torch.equal(chosen, farthest_points(cloud(), 40, seed=3))
    assert not torch.equal(chosen, farthest_points(cloud(), 40, seed=4))


def test_few_points_are_all_taken_and_constant_columns_do_not_count() -> None:
    assert farthest_points(cloud(), 1000).tolist() == list(range(560))
    points = torch.tensor([[5.0, 0.0], [5.0, 1.0], [5.0, 2.0], [5.0, 9.0]])
    assert 3 in farthest_points(points, 2).tolist()
