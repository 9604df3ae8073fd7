"""The sparse posterior against gpytorch's exact one, the length-scales that it finds, and the force as an effect."""

from __future__ import annotations

import dataclasses
import pickle

import gpytorch
import numpy as np
import pytest
import torch

from torch_activegp.diagnosis.inputs.runs import Channels
from torch_activegp.diagnosis.simulation.force_gp import Bins, ForceGP
from torch_activegp.physics import Step

NOISE = 0.05


def make_bins(rng: np.random.Generator, segments: int = 10, number: int = 12) -> Bins:
    """Bins of one joint whose force, 2 sin 3q, is measured independently in each."""
    inputs = rng.uniform(-1.0, 1.0, (segments, number, 3))
    measured = 2 * np.sin(3 * inputs[..., 0]) + NOISE * rng.normal(size=(segments, number))
    normal = np.broadcast_to(np.eye(number) / NOISE**2, (segments, number, number))
    return Bins(inputs, normal[:, None, :, None, :].copy(), measured[:, None] / NOISE**2)


@pytest.fixture
def bins() -> Bins:
    return make_bins(np.random.default_rng(0))


def test_equals_the_exact_posterior_where_every_bin_is_an_inducing_point(bins: Bins, channels: Channels) -> None:
    learned = ForceGP.on(bins, channels)
    effect = learned.posterior(bins)
    inputs = torch.from_numpy((bins.inputs.reshape(-1, 3) - learned.centre) / learned.spread)
    targets = torch.from_numpy((bins.gradient * NOISE**2 / learned.unit).ravel())
    likelihood = gpytorch.likelihoods.FixedNoiseGaussianLikelihood(
        torch.full((len(targets),), (NOISE / learned.unit[0]) ** 2, dtype=torch.float64)
    )
    exact = Exact(inputs, targets, likelihood, learned.kernel).double().eval()
    asked = np.random.default_rng(1).uniform(-1.0, 1.0, (20, 3))
    with torch.no_grad():
        mean = exact(torch.from_numpy((asked - learned.centre) / learned.spread)).mean[0] * learned.unit[0]
    np.testing.assert_allclose(effect.force(asked)[:, 0], mean.numpy(), atol=2e-3)


def test_finds_the_force_and_which_input_it_depends_on(bins: Bins, channels: Channels) -> None:
    effect = ForceGP.on(bins, channels).posterior(bins)
    asked = np.random.default_rng(1).uniform(-0.9, 0.9, (50, 3))
    np.testing.assert_allclose(effect.force(asked)[:, 0], 2 * np.sin(3 * asked[:, 0]), atol=0.15)
    assert effect.length_scales[0, 0] < 0.5 * effect.length_scales[0, 1:].min()


def test_far_from_all_data_there_is_no_force(bins: Bins, channels: Channels) -> None:
    effect = ForceGP.on(bins, channels).posterior(bins)
    assert abs(effect.force(np.full((1, 3), 1e3))[0, 0]) < 1e-9


def test_two_joints_have_forces_of_their_own(bins: Bins, channels: Channels) -> None:
    two = dataclasses.replace(channels, joints=("a", "b"), qpos=np.array([0, 1]), dof=np.array([0, 1]))
    size, number = bins.inputs.shape[:2]
    normal = np.zeros((size, 2, number, 2, number))
    normal[:, 0, :, 0], normal[:, 1, :, 1] = bins.normal[:, 0, :, 0], bins.normal[:, 0, :, 0]
    gradient = np.concatenate([bins.gradient, -3 * bins.gradient], axis=1)
    both = Bins(bins.inputs, normal, gradient)
    effect = ForceGP.on(both, two).posterior(both)
    forces = effect.force(np.array([[0.4, 0.0, 0.0]]))[0]
    np.testing.assert_allclose(forces, 2 * np.sin(1.2) * np.array([1, -3]), rtol=0.1)


def test_adds_its_force_in_its_own_rows(bins: Bins, channels: Channels) -> None:
    effect = ForceGP.on(bins, channels).posterior(bins)
    q, v, u = np.array([[0.1], [0.4], [-0.2]]), np.array([[0.3], [0.0], [0.5]]), np.array([[0.1], [0.2], [0.3]])
    force = np.ones((3, 1))
    step = Step(q, v, u, force, lambda name: np.zeros(3), np.full(3, 0.01))
    effect.before_step(step, np.array([0, 2]), np.zeros((2, 0)), None)
    expected = effect.force(np.hstack([q, v, u]))[:, 0]
    np.testing.assert_allclose(force[:, 0], 1 + expected * [1, 0, 1])


def test_survives_pickling(bins: Bins, channels: Channels) -> None:
    effect = ForceGP.on(bins, channels).posterior(bins)
    again = pickle.loads(pickle.dumps(effect))
    np.testing.assert_array_equal(again.force(bins.inputs[0]), effect.force(bins.inputs[0]))


class Exact(gpytorch.models.ExactGP):
    def __init__(
        self, x: torch.Tensor, y: torch.Tensor, likelihood: gpytorch.likelihoods.Likelihood, kernel: gpytorch.Module
    ) -> None:
        super().__init__(x[None], y[None], likelihood)
        self.mean, self.kernel = gpytorch.means.ZeroMean(batch_shape=torch.Size([1])), kernel

    def forward(self, x: torch.Tensor) -> gpytorch.distributions.MultivariateNormal:
        return gpytorch.distributions.MultivariateNormal(self.mean(x), self.kernel(x))


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_what_is_no_function_of_the_inputs_is_not_learned(channels: Channels, share: float) -> None:
    """A force of 2 N m in each bin, of any sign, that is measured to 0.05; beside a function of them, or without."""
    rng = np.random.default_rng(0)
    bins = make_bins(rng, segments=30)
    function = share * 2 * np.sin(3 * bins.inputs[..., 0])
    force = function + 2 * rng.normal(size=function.shape)
    learned = ForceGP.on(dataclasses.replace(bins, gradient=force[:, None] / NOISE**2), channels)
    noise = np.sqrt(learned.likelihood.noise.item()) * learned.unit[0]
    assert noise == pytest.approx(2.0, rel=0.2)
    effect = learned.posterior(dataclasses.replace(bins, gradient=force[:, None] / NOISE**2))
    asked = np.random.default_rng(1).uniform(-0.9, 0.9, (200, 3))
    error = effect.force(asked)[:, 0] - share * 2 * np.sin(3 * asked[:, 0])
    assert np.sqrt(np.mean(error**2)) < 0.7


def test_equations_beside_a_force_of_each_bin_are_those_of_their_covariance(bins: Bins) -> None:
    """What is measured, with the noise of each measurement and that force, against the dense Gaussian."""
    variance, unit = torch.tensor([0.3], dtype=torch.float64), np.array([2.0])
    normal, gradient, evidence = bins.beside_own_forces(variance, unit)
    n, g = torch.from_numpy(bins.normal[:, 0, :, 0]) * 4.0, torch.from_numpy(bins.gradient[:, 0]) * 2.0
    covariance = torch.linalg.inv(n)
    whole = covariance + 0.3 * torch.eye(n.shape[-1], dtype=torch.float64)
    measured = (covariance @ g[..., None])[..., 0]
    torch.testing.assert_close(normal[:, 0, :, 0], torch.linalg.inv(whole))
    torch.testing.assert_close(gradient[:, 0], torch.linalg.solve(whole, measured))
    alone, beside = (
        torch.distributions.MultivariateNormal(torch.zeros(n.shape[-1], dtype=torch.float64), c)
        .log_prob(measured)
        .sum()
        for c in (covariance, whole)
    )
    torch.testing.assert_close(evidence, beside - alone)
