"""Uncertainty: its formulas, its order of points, and what one observation tells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase

from torch_activegp import keys
from torch_activegp.acquisition import DirectedSpread, InformationGain, Spread, prior_discrepancy
from torch_activegp.models import DynamicsGP, PosteriorModule


@pytest.mark.parametrize("unit", [1.0, 0.25, [2.0, 0.5, 8.0]])
def test_spread_is_the_root_mean_square_in_units(unit: float | list[float], generator: torch.Generator) -> None:
    scale = torch.rand(7, 3, generator=generator, dtype=torch.float64)
    expected = np.sqrt(np.mean((scale.numpy() / np.array(unit)) ** 2, axis=-1, keepdims=True))
    np.testing.assert_allclose(Spread(unit).evaluate(scale).numpy(), expected, rtol=1e-14)


def test_spread_is_sigma_where_all_states_share_it() -> None:
    assert Spread().evaluate(torch.full((4, 18), 0.3, dtype=torch.float64)).flatten().tolist() == pytest.approx(
        [0.3] * 4
    )


def test_the_gain_is_the_growth_of_the_log_determinant(
    gp_with: Callable[..., DynamicsGP], points_of: Callable[..., TensorDict], generator: torch.Generator
) -> None:
    gp = gp_with(6, generator, output_scale=(0.5, 3.0))
    points = PosteriorModule(gp, out_keys=InformationGain().in_keys)(points_of(5, generator))
    gains = InformationGain()(points)["information_gain"].squeeze(-1)
    noise = gp.likelihood.noise.detach().squeeze(-1)
    for row, gain in zip(points, gains, strict=True):
        z = torch.cat([gp.inputs, torch.cat([row["state"], row["action"]]).unsqueeze(0)])
        expected = 0.0
        for variance, scale in zip(noise, gp.output_scale, strict=True):
            covariance = gp.covar_module(z).to_dense().detach() * scale**2 + variance * torch.eye(7)
            before, after = torch.linalg.slogdet(covariance[:-1, :-1])[1], torch.linalg.slogdet(covariance)[1]
            expected += after - before - variance.log()
        assert gain.item() == pytest.approx(expected.item(), rel=1e-8)


def test_the_gain_of_a_known_point_is_small_and_units_cancel(generator: torch.Generator) -> None:
    scale, noise, unit = (0.1 + torch.rand(3, generator=generator, dtype=torch.float64) for _ in range(3))
    gain = InformationGain().evaluate(scale, noise)
    torch.testing.assert_close(InformationGain().evaluate(scale / unit, noise / unit), gain, rtol=1e-14, atol=0)
    tiny = InformationGain().evaluate(torch.full((3,), 1e-10, dtype=torch.float64), torch.ones(3, dtype=torch.float64))
    assert tiny.item() == pytest.approx(3e-20)  # log1p, not the log of a rounded sum


@pytest.mark.parametrize("score", [Spread(), InformationGain(), DirectedSpread(), prior_discrepancy()])
def test_an_unseen_point_ranks_above_a_seen_one(
    score: TensorDictModuleBase,
    gp_with: Callable[..., DynamicsGP],
    generator: torch.Generator,
) -> None:
    gp = gp_with(12, generator)
    gp.begin_episode()
    seen = {"state": gp.inputs[:, :2], "action": gp.inputs[:, 2:]}
    far = torch.cat([gp.inputs[:, :1], gp.inputs[:, 1:2] + 20.0], dim=-1)
    unseen = {"state": far, "action": gp.inputs[:, 2:]}
    wanted = [key for key in score.in_keys if key in keys.POSTERIOR_KEYS]
    known, new = (
        score(PosteriorModule(gp, out_keys=wanted)(TensorDict(points, [12])))[score.out_keys[-1]]
        for points in (seen, unseen)
    )
    assert known.max() < new.min()
