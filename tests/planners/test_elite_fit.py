"""The elite fit against plain loops, and what happens where returns are not finite."""

from __future__ import annotations

import pytest
import torch

from torch_activegp.planners.elite_fit import EliteFit

INF = float("inf")


def loop_fit(actions, returns, mean, std, top_k, momentum):
    """One row at a time, with the definition: sort, drop -inf, average."""
    order = returns.argsort(descending=True)[:top_k]
    order = [i for i in order.tolist() if returns[i] > -INF]
    if not order:
        return mean, std
    elites = torch.stack([actions[i] for i in order])
    centre = elites.sum(0) / len(order)
    spread = ((elites - centre) ** 2).sum(0).div(len(order)).sqrt()
    return momentum * mean + (1 - momentum) * centre, momentum * std + (1 - momentum) * spread


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
@pytest.mark.parametrize("lost", [0, 7, 9, 12])
@pytest.mark.parametrize("top_k", [1, 4])
def test_equals_the_definition_row_by_row(batch, dtype, lost, top_k, generator):
    actions = torch.randn((*batch, 12, 5, 2), generator=generator, dtype=dtype)
    returns = torch.randn((*batch, 12), generator=generator, dtype=dtype)
    returns.view(-1, 12)[0, torch.randperm(12, generator=generator)[:lost]] = -INF
    mean = torch.randn((*batch, 1, 5, 2), generator=generator, dtype=dtype)
    std = torch.rand((*batch, 1, 5, 2), generator=generator, dtype=dtype)
    _, scores, new_mean, new_std = EliteFit(top_k, 0.3, dtype)(actions, returns, mean, std)
    assert new_mean.dtype == new_std.dtype == dtype
    rows = zip(
        *(t.reshape(-1, *t.shape[len(batch) :]) for t in (actions, returns, mean, std, new_mean, new_std)), strict=True
    )
    for row_actions, row_returns, row_mean, row_std, found_mean, found_std in rows:
        wanted = loop_fit(row_actions, row_returns, row_mean, row_std, top_k, 0.3)
        torch.testing.assert_close((found_mean, found_std), (wanted[0].view(1, 5, 2), wanted[1].view(1, 5, 2)))
    torch.testing.assert_close(scores, returns.sort(dim=-1, descending=True).values[..., :top_k])


def test_lost_elites_are_replaced_by_the_best():
    actions = torch.arange(4.0).view(4, 1, 1)
    fit = EliteFit(3, 0.0, torch.float32)
    elites, scores, mean, std = fit(actions, torch.tensor([-INF, 1.0, -INF, -INF]), *torch.ones(2, 1, 1, 1))
    assert elites.flatten().tolist() == [1.0, 1.0, 1.0]
    assert scores.tolist() == [1.0, -INF, -INF]
    assert mean.item() == 1.0 and std.item() == 0.0


def test_a_single_elite_has_std_zero_and_not_nan():
    elites, _, mean, std = EliteFit(1, 0.1)(
        torch.ones(3, 2, 1, dtype=torch.float64),
        torch.arange(3.0, dtype=torch.float64),
        *torch.ones(2, 1, 2, 1, dtype=torch.float64),
    )
    assert elites.shape == (1, 2, 1)
    torch.testing.assert_close(mean, torch.ones(1, 2, 1, dtype=torch.float64))
    torch.testing.assert_close(std, torch.full((1, 2, 1), 0.1, dtype=torch.float64))
