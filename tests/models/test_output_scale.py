"""The signal's scale in closed form, against a search and against gpytorch."""

from __future__ import annotations

from collections.abc import Callable

import gpytorch
import pytest
import torch
from gpytorch.kernels import MaternKernel, RBFKernel
from gpytorch.likelihoods import GaussianLikelihood
from torch import Tensor

from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, FixedNoise, LearnedNoise, NoiseSchedule, fit_output_scale
from torch_activegp.simulators import Pendulum

DOUBLE = torch.float64
Draw = Callable[[int], tuple[Tensor, Tensor, Tensor]]


def log_likelihood(gp: DynamicsGP) -> Tensor:
    """gpytorch's log marginal likelihood of each output, at fixed relative noise."""
    mll = gpytorch.mlls.ExactMarginalLogLikelihood(gp.likelihood, gp)
    gp.train()
    value = mll(gp(*gp.train_inputs), gp.train_targets).detach() * gp.num_points
    gp.eval()
    return value


def make(prior: Pendulum, noise: NoiseSchedule, batch_shape: tuple[int, ...] = ()) -> DynamicsGP:
    likelihood = GaussianLikelihood(
        batch_shape=torch.Size([2]), noise_constraint=gpytorch.constraints.GreaterThan(1e-14)
    )
    kernel = MaternKernel(batch_shape=torch.Size(batch_shape))
    return DynamicsGP(EpisodicMean(SimulatorMean(prior)), kernel, noise=noise, likelihood=likelihood)


@pytest.mark.parametrize("noise", [FixedNoise(1e-2), LearnedNoise()])
@pytest.mark.parametrize("batch_shape", [(), (2,)])
def test_it_maximises_the_likelihood_and_keeps_the_mean(
    batch_shape: tuple[int, ...], noise: NoiseSchedule, prior: Pendulum, transitions: Draw
) -> None:
    gp = make(prior, noise, batch_shape)
    gp.update(*transitions(25))
    z = torch.cat(transitions(6)[:2], dim=-1)
    loc = gp.posterior.loc(gp.posterior.features(z))
    relative = gp.posterior.noise.clone()
    fit_output_scale(gp)
    torch.testing.assert_close(gp.posterior.noise, relative, rtol=1e-9, atol=0)
    torch.testing.assert_close(gp.posterior.loc(gp.posterior.features(z)), loc, rtol=0, atol=1e-10)
    best, scale, variance = log_likelihood(gp), gp.output_scale.clone(), gp.likelihood.noise.detach().clone()
    for factor in (0.9, 0.99, 1.01, 1.1):
        gp.output_scale = scale * factor
        gp.likelihood.noise = variance * factor**2
        assert bool((log_likelihood(gp) < best).all())


def test_a_known_scale_is_recovered(generator: torch.Generator) -> None:
    size, truth = 400, torch.tensor([0.02, 5.0], dtype=DOUBLE)
    state, action = torch.rand(2, size, 2, generator=generator, dtype=DOUBLE) * 6
    gp = DynamicsGP(gpytorch.means.ZeroMean(batch_shape=torch.Size([2])), RBFKernel(), noise=FixedNoise(1e-3))
    with torch.no_grad():
        covariance = gp.covar_module(torch.cat([state, action], -1)).to_dense() + 1e-3 * torch.eye(size, dtype=DOUBLE)
    draw = torch.linalg.cholesky(covariance) @ torch.randn(size, 2, generator=generator, dtype=DOUBLE)
    gp.update(state, action, draw * truth)
    fit_output_scale(gp)
    torch.testing.assert_close(gp.output_scale, truth, rtol=0.1, atol=0)


def test_a_perfect_simulator_leaves_the_smallest_scale(transitions: Draw) -> None:
    gp = make(Pendulum(), FixedNoise(1e-2))
    gp.update(*transitions(1))
    fit_output_scale(gp)
    assert gp.output_scale.tolist() == [1.0, 1.0]  # one point says nothing
    gp.update(*transitions(9))
    fit_output_scale(gp, smallest=1e-5)
    assert gp.output_scale.tolist() == [1e-5, 1e-5]
