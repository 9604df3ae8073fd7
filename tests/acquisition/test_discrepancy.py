"""How far the model moved: the formula, both references, and no call of the simulator."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from torch_activegp import keys
from torch_activegp.acquisition import Discrepancy
from torch_activegp.models import DynamicsGP, PosteriorModule
from torch_activegp.simulators import Pendulum

QUANTITIES = (keys.LOC, keys.PRIOR_LOC, keys.SIMULATOR_LOC)


@pytest.mark.parametrize("unit", [1.0, 0.25, [2.0, 0.5, 8.0]])
def test_it_is_the_euclidean_norm_in_units(unit: float | list[float], generator: torch.Generator) -> None:
    loc = torch.randn(7, 3, generator=generator, dtype=torch.float64)
    reference = torch.randn(7, 3, generator=generator, dtype=torch.float64)
    expected = np.sqrt(np.sum(((loc - reference).numpy() / np.array(unit)) ** 2, axis=-1, keepdims=True))
    np.testing.assert_allclose(Discrepancy(unit).evaluate(loc, reference).numpy(), expected, rtol=1e-14)


def test_the_default_reference_is_the_episode_prior_and_in_keys_choose_p0(
    gp_with: Callable[..., DynamicsGP],
    points_of: Callable[..., TensorDict],
    learn_from: Callable[..., None],
    generator: torch.Generator,
) -> None:
    gp = gp_with(6, generator)
    gp.begin_episode()
    learn_from(gp, points_of(3, generator))
    points = PosteriorModule(gp, out_keys=QUANTITIES)(points_of(9, generator))
    state, action = points["state"], points["action"]
    z = torch.cat([state, action], -1)
    to_prior, to_simulator = (points["loc"] - m for m in (gp.mean_module.reference(z), Pendulum(m=0.7)(state, action)))
    Discrepancy()(points)
    Discrepancy(in_keys=[keys.LOC, keys.SIMULATOR_LOC], out_keys=["from p0"])(points)
    torch.testing.assert_close(points["discrepancy"].squeeze(-1), to_prior.norm(dim=-1), rtol=1e-9, atol=1e-12)
    torch.testing.assert_close(points["from p0"].squeeze(-1), to_simulator.norm(dim=-1), rtol=1e-9, atol=1e-12)
    assert (points["discrepancy"] - points["from p0"]).abs().max() > 1e-3


@pytest.mark.parametrize("num_points", [0, 5])
def test_it_is_zero_before_the_first_point_of_an_episode(
    num_points: int,
    gp_with: Callable[..., DynamicsGP],
    points_of: Callable[..., TensorDict],
    generator: torch.Generator,
) -> None:
    gp = gp_with(num_points, generator)
    gp.begin_episode()
    points = Discrepancy()(PosteriorModule(gp, out_keys=QUANTITIES)(points_of(9, generator)))
    assert points["discrepancy"].abs().max() < 1e-12


def test_the_simulator_is_called_once_for_the_posterior_and_never_for_the_score(
    gp_with: Callable[..., DynamicsGP], points_of: Callable[..., TensorDict], generator: torch.Generator
) -> None:
    gp = gp_with(6, generator)
    gp.begin_episode()
    gp.posterior  # noqa: B018 - the cache is filled
    simulator = gp.mean_module.base_mean.simulator
    before = simulator.calls
    points = PosteriorModule(gp, out_keys=QUANTITIES)(points_of(9, generator))
    assert simulator.calls == before + 1
    Discrepancy()(points)
    Discrepancy(in_keys=[keys.LOC, keys.SIMULATOR_LOC])(points)
    assert simulator.calls == before + 1
