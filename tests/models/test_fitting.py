"""Fitting hyper-parameters: the objective against gpytorch's, and what a fit finds."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from itertools import pairwise

import gpytorch
import numpy as np
import pytest
import torch
from gpytorch.constraints import GreaterThan
from gpytorch.kernels import Kernel, LinearKernel, MaternKernel, RBFKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.priors import GammaPrior, LogNormalPrior, NormalPrior
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import (
    DynamicsGP,
    FixedNoise,
    InverseSquareNoise,
    LearnedNoise,
    NoiseSchedule,
    fit_hyperparameters,
    scaled_rbf,
)
from torch_activegp.models.fitting import _Objective
from torch_activegp.simulators import FunctionSimulator, Pendulum, StateSpace

DOUBLE = torch.float64
TWO = torch.Size([2])
Draw = Callable[[int], tuple[Tensor, Tensor, Tensor]]
LOW = torch.tensor([-math.pi, -8.0, -2.0], dtype=DOUBLE)


def pendulum_gp(noise: NoiseSchedule | None = None, kernel: Kernel | None = None, **options: object) -> DynamicsGP:
    mean = EpisodicMean(SimulatorMean(Pendulum(g=9.0, m=0.5, l=2.0)))
    return DynamicsGP(mean, kernel or scaled_rbf(LOW, -LOW), noise=noise or LearnedNoise(), **options)


def log_posterior(gp: DynamicsGP, all_parts_are_batched: bool) -> float:
    """gpytorch's log marginal likelihood of all outputs, plus the log density of each prior once."""
    gp.train()
    output = gp(*gp.train_inputs)
    value = gp.likelihood(output).log_prob(gp.train_targets).sum()
    value = value + sum(p.log_prob(closure(owner)).sum() for _, owner, p, closure, _ in gp.named_priors())
    if all_parts_are_batched:  # otherwise gpytorch counts a shared prior once for each output
        mll = gpytorch.mlls.ExactMarginalLogLikelihood(gp.likelihood, gp)
        torch.testing.assert_close(mll(output, gp.train_targets).sum() * gp.num_points, value)
    gp.eval()
    return value.item()


def with_priors(batch_shape: tuple[int, ...]) -> Kernel:
    inner = MaternKernel(
        nu=2.5, ard_num_dims=3, batch_shape=torch.Size(batch_shape), lengthscale_prior=LogNormalPrior(0.5, 1.0)
    )
    return ScaleKernel(inner, batch_shape=torch.Size(batch_shape), outputscale_prior=GammaPrior(2.0, 0.5))


@pytest.mark.parametrize("noise_prior", [False, True])
@pytest.mark.parametrize("learned", [False, True])
@pytest.mark.parametrize("batch_shape", [(), (2,)])
def test_the_objective_is_gpytorchs(
    batch_shape: tuple[int, ...], learned: bool, noise_prior: bool, transitions: Draw
) -> None:
    """The loss is in standard units: the density of y / s is that of y times the product of the scales s."""
    likelihood = GaussianLikelihood(
        batch_shape=TWO,
        noise_constraint=GreaterThan(1e-14),
        noise_prior=GammaPrior(1.5, 2.0) if noise_prior and learned else None,
    )
    noise = LearnedNoise() if learned else FixedNoise(0.02)
    gp = pendulum_gp(noise, with_priors(batch_shape), likelihood=likelihood)
    for _ in range(2):  # the snapshot of the kernel that the episodes leave must not enter
        gp.update(*transitions(12))
        gp.mean_module.expansions = nn.ModuleList()
    result = fit_hyperparameters(gp, max_iterations=6)
    jacobian = gp.num_points * result.output_scale.log().sum().item()
    expected = -(log_posterior(gp, batch_shape == (2,)) + jacobian) / (2 * gp.num_points)
    assert result.loss == pytest.approx(expected, rel=1e-8)
    assert torch.equal(result.output_scale, gp.output_scale)


def test_the_snapshots_of_past_kernels_do_not_enter(transitions: Draw) -> None:
    gp = pendulum_gp()
    gp.update(*transitions(12))
    plain = copy.deepcopy(gp)
    gp.begin_episode()
    assert fit_hyperparameters(gp).loss == pytest.approx(fit_hyperparameters(plain).loss, rel=1e-10)


def synthetic(
    lengthscales: list[float], noise: float, scale: list[float], size: int, generator: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """A draw from a GP over three inputs in [0, 1]: one state, two actions; the state's own entry is an input too."""
    z = torch.rand(size, 3, generator=generator, dtype=DOUBLE)
    difference = (z[:, None] - z[None]) / torch.tensor(lengthscales, dtype=DOUBLE)
    covariance = torch.exp(-difference.square().sum(-1) / 2) + noise * torch.eye(size, dtype=DOUBLE)
    draw = torch.linalg.cholesky(covariance) @ torch.randn(size, len(scale), generator=generator, dtype=DOUBLE)
    return z[:, : len(scale)], z[:, len(scale) :], draw * torch.tensor(scale, dtype=DOUBLE)


def test_known_lengthscales_noise_and_scales_are_recovered(generator: torch.Generator) -> None:
    truth, noise, scale = [0.15, 0.4, 1.2], 0.02, [0.01, 30.0]
    gp = DynamicsGP(
        gpytorch.means.ZeroMean(batch_shape=TWO), scaled_rbf(torch.zeros(3), torch.ones(3)), noise=LearnedNoise()
    )
    gp.update(*synthetic(truth, noise, scale, 300, generator))
    result = fit_hyperparameters(gp, max_iterations=100)
    assert result.converged
    lengthscale = gp.covar_module.base_kernel.lengthscale.detach()[0]
    torch.testing.assert_close(lengthscale, torch.tensor(truth, dtype=DOUBLE), rtol=0.3, atol=0)
    noise_scale = math.sqrt(result.noise) * result.output_scale
    torch.testing.assert_close(gp.posterior.noise_scale, noise_scale, rtol=1e-9, atol=0)
    ratio = noise_scale / (math.sqrt(noise) * torch.tensor(scale, dtype=DOUBLE))
    assert ratio.log().mean().exp().item() == pytest.approx(1.0, rel=0.15)
    assert bool(((ratio > 0.7) & (ratio < 1.4)).all())  # the outputs share one ratio of noise to size of the residual


def test_a_fit_makes_predictions_better(transitions: Draw) -> None:
    """Standard length-scales of the wrong size: the fitted model predicts unseen transitions better."""
    errors = {}
    data, (state, action, next_state) = transitions(80), transitions(300)
    for fitted in (False, True):
        kernel = scaled_rbf(LOW, -LOW)
        kernel.base_kernel.lengthscale = 0.3
        gp = pendulum_gp(kernel=kernel)
        gp.update(*data)
        if fitted:
            fit_hyperparameters(gp)
        loc = gp.posterior.loc(gp.posterior.features(torch.cat([state, action], dim=-1)))
        errors[fitted] = gp.state_space.difference(loc, next_state).square().mean()
    assert errors[True] < 0.1 * errors[False]


def test_a_parameter_of_the_simulator_is_learned(generator: torch.Generator) -> None:
    """The mass is wrong; all else is right. Targets on both sides of the seam must not mislead."""
    truth = Pendulum(m=1.0)
    simulator = Pendulum(m=1.7, trainable=True)
    simulator.g.requires_grad_(False)
    simulator.l.requires_grad_(False)
    gp = DynamicsGP(SimulatorMean(simulator), scaled_rbf(LOW, -LOW), noise=LearnedNoise())
    state = truth.state_space.sample((80,), generator)
    state[:20, 0] = math.pi - 0.05 * torch.rand(20, generator=generator, dtype=DOUBLE)
    action = truth.action_space.sample((80,), generator)
    noise = 1e-4 * torch.randn(80, 2, generator=generator, dtype=DOUBLE)
    gp.update(state, action, truth(state, action) + noise)
    result = fit_hyperparameters(gp)
    assert simulator.m.item() == pytest.approx(1.0, rel=2e-2)
    assert result.loss < -1.5
    assert simulator.m.grad is None


def test_a_mean_that_crosses_the_seam_while_it_is_trained(generator: torch.Generator) -> None:
    """The start is off by 0.4 rad; on the way to the truth every prediction passes pi."""
    space = StateSpace(["angle"], [-math.pi], [math.pi], angles=[0])

    class Turn(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.offset = nn.Parameter(torch.tensor(-0.3, dtype=DOUBLE))

        def forward(self, state: Tensor, action: Tensor) -> Tensor:
            return state + action + self.offset

    turn = Turn()
    gp = DynamicsGP(SimulatorMean(FunctionSimulator(turn, space, 1, dt=0.1)), scaled_rbf(-torch.ones(2), torch.ones(2)))
    state = math.pi - 0.01 * torch.rand(30, 1, generator=generator, dtype=DOUBLE)
    action = 0.02 * torch.rand(30, 1, generator=generator, dtype=DOUBLE)
    gp.update(state, action, space.wrap(state + action + 0.1))
    fit_hyperparameters(gp)
    assert turn.offset.item() == pytest.approx(0.1, abs=0.05)
    residual = gp.posterior.inputs.new_tensor(0.1) - turn.offset
    torch.testing.assert_close(
        gp.targets - gp.mean_module.predict(gp.inputs), residual.expand(30, 1), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("noise", [LearnedNoise(), FixedNoise(1e-3), InverseSquareNoise()])
@pytest.mark.parametrize("max_iterations", [1, 3, 50])
def test_it_never_ends_worse_than_it_began(max_iterations: int, noise: NoiseSchedule, transitions: Draw) -> None:
    gp = pendulum_gp(noise)
    gp.update(*transitions(30))
    losses = [fit_hyperparameters(gp, max_iterations=max_iterations).loss for _ in range(4)]
    assert all(later <= earlier + 1e-9 for earlier, later in pairwise(losses)), losses


def test_a_second_fit_starts_from_the_noise_of_the_first(generator: torch.Generator) -> None:
    gp = DynamicsGP(
        gpytorch.means.ZeroMean(batch_shape=TWO), scaled_rbf(torch.zeros(3), torch.ones(3)), noise=LearnedNoise()
    )
    gp.update(*synthetic([0.3, 0.4, 0.5], 1e-5, [1.0, 1.0], 100, generator))
    first = fit_hyperparameters(gp, max_iterations=100)
    assert first.noise < 1e-3
    second = fit_hyperparameters(gp, max_iterations=1)
    assert second.loss <= first.loss + 1e-12
    assert second.noise == pytest.approx(first.noise, rel=0.2)


def test_parameters_at_which_nothing_can_be_computed_are_survived(transitions: Draw) -> None:
    """The first step of the optimiser overshoots to a negative mass and to masses that give NaN."""
    simulator = Pendulum(m=0.02, trainable=True)
    gp = DynamicsGP(SimulatorMean(simulator), scaled_rbf(LOW, -LOW), noise=LearnedNoise())
    gp.update(*transitions(30))
    result = fit_hyperparameters(gp)
    assert math.isfinite(result.loss)
    assert all(bool(torch.isfinite(parameter).all()) for parameter in gp.parameters())


def test_a_loss_that_is_never_finite_leaves_everything(transitions: Draw) -> None:
    class Wild(NormalPrior):
        def log_prob(self, value: Tensor) -> Tensor:
            return value * torch.nan if bool((value != 1.5).any()) else value * 0.0

    kernel = RBFKernel(lengthscale_prior=Wild(0.0, 1.0))
    kernel.lengthscale = 1.5
    gp = pendulum_gp(FixedNoise(1e-2), kernel)
    gp.update(*transitions(10))
    before = gp.covar_module.raw_lengthscale.detach().clone()
    gp.covar_module.lengthscale_prior.__class__ = Wild
    fit_hyperparameters(gp)
    torch.testing.assert_close(gp.covar_module.raw_lengthscale.detach(), before)


def test_a_covariance_that_cannot_be_factored_is_very_bad(transitions: Draw) -> None:
    gp = pendulum_gp(kernel=RBFKernel())
    gp.update(*transitions(10))
    objective = _Objective(gp, torch.arange(10), standardize=True)
    start = objective.pack()
    value, gradient = objective(np.full_like(start, math.nan))
    assert value > objective(start)[0] + 100
    assert not gradient.any()


def test_it_is_deterministic_and_the_subset_is_the_generators(transitions: Draw) -> None:
    gp = pendulum_gp()
    gp.update(*transitions(60))

    def fit(seed: int | None, max_points: int) -> Tensor:
        model = copy.deepcopy(gp)
        generator = None if seed is None else torch.Generator().manual_seed(seed)
        fit_hyperparameters(model, max_points=max_points, generator=generator)
        return torch.cat([model.covar_module.base_kernel.lengthscale.detach()[0], model.output_scale])

    state = torch.get_rng_state()
    whole = fit(1, 60)
    assert torch.equal(fit(2, 60), whole)
    assert torch.equal(fit(3, 30), fit(3, 30))
    assert not torch.equal(fit(3, 30), fit(4, 30))
    assert torch.equal(fit(None, 30), fit(0, 30))
    assert torch.equal(torch.get_rng_state(), state)  # the global source of chance is not touched


def test_the_schedules_noise_is_kept(transitions: Draw) -> None:
    gp = pendulum_gp(InverseSquareNoise())
    gp.update(*transitions(20))
    result = fit_hyperparameters(gp)
    assert result.noise is None
    torch.testing.assert_close(gp.posterior.noise, torch.tensor([1 / 400], dtype=DOUBLE), rtol=1e-9, atol=0)
    assert gp.posterior.noise.shape == (1,)  # one factor still serves both outputs


def test_the_limit_of_the_likelihood_is_kept(generator: torch.Generator) -> None:
    gp = DynamicsGP(
        gpytorch.means.ZeroMean(batch_shape=TWO),
        scaled_rbf(torch.zeros(3), torch.ones(3)),
        likelihood=GaussianLikelihood(batch_shape=TWO),  # not below 1e-4
    )
    gp.update(*synthetic([0.5, 0.5, 0.5], 1e-7, [1.0, 1.0], 60, generator))
    result = fit_hyperparameters(gp)
    assert result.noise * result.output_scale.square().min() == pytest.approx(1e-4, rel=1e-3)
    assert bool((gp.likelihood.noise >= 1e-4).all())


def test_a_shared_noise_becomes_the_mean_over_outputs(transitions: Draw) -> None:
    gp = pendulum_gp(likelihood=GaussianLikelihood(noise_constraint=GreaterThan(1e-14)))
    gp.update(*transitions(20))
    result = fit_hyperparameters(gp)
    expected = (result.noise * result.output_scale.square()).mean().item()
    assert gp.likelihood.noise.item() == pytest.approx(expected)


@pytest.mark.parametrize("standardize", [True, False])
def test_the_output_scale_is_the_residuals_size_or_left_alone(standardize: bool, transitions: Draw) -> None:
    gp = pendulum_gp(output_scale=torch.tensor([0.2, 0.7]))
    gp.update(*transitions(30))
    residual = gp.targets - gp.mean_module.base(gp.inputs)
    fit_hyperparameters(gp, standardize=standardize)
    expected = residual.square().mean(0).sqrt() if standardize else torch.tensor([0.2, 0.7], dtype=DOUBLE)
    torch.testing.assert_close(gp.output_scale, expected, rtol=1e-6, atol=0)


def test_a_perfect_simulator_has_a_scale_above_zero(transitions: Draw) -> None:
    gp = DynamicsGP(SimulatorMean(Pendulum()), scaled_rbf(LOW, -LOW), noise=LearnedNoise())
    gp.update(*transitions(10))
    result = fit_hyperparameters(gp)
    assert bool((gp.output_scale > 0).all())
    assert math.isfinite(result.loss)


def test_nothing_to_fit_is_no_error(transitions: Draw) -> None:
    gp = pendulum_gp(FixedNoise(1e-2), LinearKernel().requires_grad_(False))
    gp.update(*transitions(10))
    result = fit_hyperparameters(gp)
    assert result.converged
    assert result.noise is None


@pytest.mark.parametrize("points", [0, 1])
def test_too_few_points(points: int, transitions: Draw) -> None:
    gp = pendulum_gp()
    gp.update(*transitions(points))
    with pytest.raises(ConfigurationError, match=f"at least 2 points to fit, found {points}. Collect an episode"):
        fit_hyperparameters(gp)


def test_the_cached_posterior_follows_a_fit(transitions: Draw) -> None:
    gp = pendulum_gp()
    gp.update(*transitions(20))
    kept, z = gp.posterior, torch.cat(transitions(5)[:2], dim=-1)
    fit_hyperparameters(gp)
    assert gp.posterior is not kept
    features = gp.posterior.features(z)
    torch.testing.assert_close(gp(z).mean.mT.detach(), gp.posterior.loc(features), rtol=0, atol=1e-7)


def test_scaled_rbf_has_its_medians_in_the_box() -> None:
    kernel = scaled_rbf(LOW, -LOW)
    torch.testing.assert_close(kernel.base_kernel.lengthscale[0], -LOW / 2)
    assert kernel.outputscale.item() == pytest.approx(1.0)
    prior = kernel.base_kernel.lengthscale_prior
    torch.testing.assert_close(prior.icdf(torch.tensor(0.5, dtype=DOUBLE)), -LOW / 2)
    assert kernel.base_kernel.raw_lengthscale.dtype == DOUBLE


@pytest.mark.parametrize(("low", "high"), [(-math.inf, 1.0), (0.0, math.inf), (1.0, 1.0), (2.0, 1.0), (math.nan, 1.0)])
def test_scaled_rbf_wants_a_box(low: float, high: float) -> None:
    with pytest.raises(
        ConfigurationError, match="Wanted finite, non-empty ranges, found .* Pass the smallest and larg"
    ):
        scaled_rbf(torch.tensor([0.0, low]), torch.tensor([1.0, high]))
