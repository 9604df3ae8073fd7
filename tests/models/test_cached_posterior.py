"""The cached posterior against gpytorch's own, over kernels, means, recursions, noise schedules and scales."""

from __future__ import annotations

from collections.abc import Callable

import gpytorch
import pytest
import torch
from gpytorch.kernels import Kernel, LinearKernel, MaternKernel, PeriodicKernel, RBFKernel, RQKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.means import Mean
from torch import Tensor

from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import (
    CachedPosterior,
    DynamicsGP,
    FixedNoise,
    HeldNoise,
    InverseSquareNoise,
    LearnedNoise,
    NoiseSchedule,
)
from torch_activegp.models.cached_posterior import Features
from torch_activegp.simulators import FunctionSimulator, Pendulum

DOUBLE = torch.float64
TWO = torch.Size([2])


def ard(kernel: Kernel) -> Kernel:
    kernel.lengthscale = torch.tensor([[1.0, 4.0, 2.0]])
    return kernel


def batched(kernel: Kernel) -> Kernel:
    kernel.lengthscale = torch.tensor([0.8, 2.5]).reshape(2, 1, 1)
    return kernel


KERNELS: dict[str, Callable[[], Kernel]] = {
    "rbf": RBFKernel,
    "rbf ard": lambda: ard(RBFKernel(ard_num_dims=3)),
    "matern 1/2": lambda: MaternKernel(nu=0.5),
    "matern 3/2": lambda: MaternKernel(nu=1.5),
    "matern 5/2 ard": lambda: ard(MaternKernel(nu=2.5, ard_num_dims=3)),
    "periodic": PeriodicKernel,
    "rational quadratic": RQKernel,
    "linear": LinearKernel,
    "scale": lambda: ScaleKernel(ard(RBFKernel(ard_num_dims=3))),
    "active dims": lambda: RBFKernel(active_dims=[0, 1]) + MaternKernel(active_dims=[2]),
    "sum": lambda: ScaleKernel(RBFKernel()) + LinearKernel(),
    "product": lambda: RBFKernel(active_dims=[1, 2]) * PeriodicKernel(active_dims=[0]),
    "rbf an output": lambda: batched(RBFKernel(batch_shape=TWO)),
    "scale an output": lambda: ScaleKernel(MaternKernel(), batch_shape=TWO),
}


def simulator() -> SimulatorMean:
    return SimulatorMean(Pendulum(g=9.0, m=0.5, l=2.0))


MEANS: dict[str, Callable[[], Mean]] = {
    "zero": lambda: gpytorch.means.ZeroMean(batch_shape=TWO),
    "constant": gpytorch.means.ConstantMean,
    "linear": lambda: gpytorch.means.LinearMean(3, batch_shape=TWO),
    "simulator": simulator,
    "paper": lambda: EpisodicMean(simulator(), recursion="paper"),
    "bayes": lambda: EpisodicMean(simulator(), recursion="bayes"),
    "paper constant": lambda: EpisodicMean(gpytorch.means.ConstantMean(), recursion="paper", num_outputs=2),
}
NOISES: dict[str, Callable[[], NoiseSchedule]] = {
    "append": lambda: FixedNoise(1e-3),
    "refactor": InverseSquareNoise,
    "held": lambda: HeldNoise(InverseSquareNoise(), 2.0),
}
SCALES = {"unit": torch.ones(2), "scaled": torch.tensor([0.3, 2.0])}


def make(kernel: str, mean: str, noise: str = "append", scale: str = "unit") -> DynamicsGP:
    torch.manual_seed(0)  # gpytorch draws the weights of a linear mean
    space = None if mean in ("simulator", "paper", "bayes") else Pendulum().state_space
    return DynamicsGP(
        MEANS[mean](), KERNELS[kernel](), noise=NOISES[noise](), output_scale=SCALES[scale], state_space=space
    )


def assert_equal_to_gpytorch(gp: DynamicsGP, z: Tensor, tolerance: float = 1e-8) -> None:
    posterior, expected = gp.posterior, gp(z)
    features = posterior.features(z)
    for value, wanted in (
        (posterior.loc(features), expected.mean.mT),
        (posterior.variance(features), expected.variance.mT),
        (posterior.scale(features).square(), expected.variance.mT),
    ):
        torch.testing.assert_close(value, wanted.detach(), rtol=0, atol=tolerance)


def change_hyperparameters(gp: DynamicsGP) -> None:
    with torch.no_grad():
        for parameter in gp.covar_module.parameters():
            parameter.add_(0.3)


@pytest.mark.parametrize("mean", MEANS)
@pytest.mark.parametrize(
    ("kernel", "noise"),
    [
        *((kernel, "append") for kernel in KERNELS),
        *((kernel, "refactor") for kernel in ("rbf", "product", "rbf an output")),
    ],
)
def test_it_equals_gpytorch_through_three_episodes(
    kernel: str, mean: str, noise: str, transitions: Callable[[int], tuple[Tensor, ...]]
) -> None:
    gp = make(kernel, mean, noise, scale="scaled")
    z = torch.cat(transitions(9)[:2], dim=-1)
    assert_equal_to_gpytorch(gp, z)
    for episode in range(3):
        for _ in range(4):
            gp.update(*transitions(1))
            assert gp.posterior.num_points == gp.num_points  # a query between two points, so that they are appended
        assert_equal_to_gpytorch(gp, z)
        if episode == 1:
            change_hyperparameters(gp)
            assert_equal_to_gpytorch(gp, z)
        gp.begin_episode()
        assert_equal_to_gpytorch(gp, z)


@pytest.mark.parametrize("mean", ["simulator", "paper", "bayes"])
@pytest.mark.parametrize("kernel", ["rbf ard", "matern 3/2", "sum", "rbf an output"])
def test_appending_equals_computing_anew(
    kernel: str,
    mean: str,
    transitions: Callable[[int], tuple[Tensor, ...]],
    predict: Callable[[CachedPosterior, Tensor], tuple[Tensor, Tensor]],
) -> None:
    gp = make(kernel, mean)
    z = torch.cat(transitions(9)[:2], dim=-1)
    for _ in range(2):
        gp.update(*transitions(5))
        kept = gp.posterior
        gp.update(*transitions(30))
        assert gp.posterior is kept  # appended, not made anew
        assert kept.num_points == gp.num_points
        appended = [*predict(gp.posterior, z), gp.posterior.prior_loc(gp.posterior.features(z))]
        gp.forget()
        anew = [*predict(gp.posterior, z), gp.posterior.prior_loc(gp.posterior.features(z))]
        assert gp.posterior is not kept
        for ours, fresh in zip(appended, anew, strict=True):
            torch.testing.assert_close(ours, fresh, rtol=0, atol=1e-10)
        gp.begin_episode()


@pytest.mark.parametrize("noise", NOISES)
@pytest.mark.parametrize("kernel", ["rbf ard", "rbf an output"])
@pytest.mark.parametrize("mean", ["paper", "bayes"])
def test_the_discrepancy_is_zero_at_the_start_of_every_episode(
    mean: str, kernel: str, noise: str, transitions: Callable[[int], tuple[Tensor, ...]]
) -> None:
    gp = make(kernel, mean, noise)
    z = torch.cat(transitions(20)[:2], dim=-1)
    for _ in range(3):
        posterior = gp.posterior
        features = posterior.features(z)
        torch.testing.assert_close(posterior.loc(features), posterior.prior_loc(features), rtol=0, atol=1e-12)
        gp.update(*transitions(6))
        posterior = gp.posterior
        features = posterior.features(z)
        assert (posterior.loc(features) - posterior.prior_loc(features)).abs().max() > 1e-3
        before = posterior.loc(features)
        gp.begin_episode()
        prior_loc = gp.posterior.prior_loc(gp.posterior.features(z))
        torch.testing.assert_close(prior_loc, before, rtol=0, atol=1e-12)  # m_tau is the posterior before


@pytest.mark.parametrize("mean", ["paper", "bayes"])
def test_the_prior_stays_when_the_kernel_changes(mean: str, transitions: Callable[[int], tuple[Tensor, ...]]) -> None:
    gp = make("rbf ard", mean)
    z = torch.cat(transitions(20)[:2], dim=-1)
    gp.update(*transitions(8))
    before = gp.posterior.loc(gp.posterior.features(z))
    gp.begin_episode()
    change_hyperparameters(gp)
    for _ in range(2):
        features = gp.posterior.features(z)
        torch.testing.assert_close(gp.posterior.prior_loc(features), before, rtol=0, atol=1e-12)
        if mean == "paper" and gp.count.step == 0:
            assert torch.equal(gp.posterior.loc(features), gp.posterior.prior_loc(features))
        gp.update(*transitions(3))


@pytest.mark.parametrize("mean", ["paper", "bayes"])
def test_the_number_of_heads_may_change_between_episodes(
    mean: str, transitions: Callable[[int], tuple[Tensor, ...]]
) -> None:
    gp = DynamicsGP(MEANS[mean](), KERNELS["rbf ard"](), noise=LearnedNoise())
    z = torch.cat(transitions(9)[:2], dim=-1)
    for noise in ([0.1, 0.1], [0.1, 0.3], [0.2, 0.2]):
        before = gp.posterior.loc(gp.posterior.features(z))
        gp.begin_episode()
        gp.likelihood.noise = torch.tensor(noise, dtype=DOUBLE).unsqueeze(-1)
        assert gp.posterior.factor.inverse.shape[0] == len(set(noise))
        features = gp.posterior.features(z)
        torch.testing.assert_close(gp.posterior.prior_loc(features), before, rtol=0, atol=1e-12)
        gp.update(*transitions(4))
        assert_equal_to_gpytorch(gp, z)


@pytest.mark.parametrize("noise_shape", [(), (2,)])
def test_any_gaussian_likelihood_can_be_injected(
    noise_shape: tuple[int, ...], transitions: Callable[[int], tuple[Tensor, ...]]
) -> None:
    likelihood = GaussianLikelihood(batch_shape=torch.Size(noise_shape))
    likelihood.noise = 0.2
    gp = DynamicsGP(simulator(), KERNELS["rbf ard"](), likelihood=likelihood, output_scale=SCALES["scaled"])
    gp.update(*transitions(10))
    torch.testing.assert_close(gp.posterior.noise_scale, torch.full((2,), 0.2, dtype=DOUBLE).sqrt(), rtol=1e-6, atol=0)
    assert_equal_to_gpytorch(gp, torch.cat(transitions(9)[:2], dim=-1))


def test_one_output(generator: torch.Generator) -> None:
    mean = SimulatorMean(FunctionSimulator(lambda state, action: 0.9 * state + action, 1, 1, dt=0.1))
    gp = DynamicsGP(EpisodicMean(mean), RBFKernel())
    for _ in range(2):
        state, action, noise = torch.rand(3, 5, 1, generator=generator, dtype=DOUBLE)
        gp.update(state, action, state.sin() + action + noise)
        assert_equal_to_gpytorch(gp, torch.rand(4, 2, generator=generator, dtype=DOUBLE))
        gp.begin_episode()


def test_without_data_it_is_the_prior(transitions: Callable[[int], tuple[Tensor, ...]]) -> None:
    gp = make("scale an output", "simulator", scale="scaled")
    z = torch.cat(transitions(9)[:2], dim=-1)
    posterior = gp.posterior
    features = posterior.features(z)
    assert features.cross.shape == (2, 9, 0)
    assert torch.equal(posterior.loc(features), gp.mean_module.predict(z))
    assert torch.equal(posterior.prior_loc(features), gp.mean_module.predict(z))
    expected = gp.covar_module.outputscale.detach().expand(9, 2) * gp.output_scale.square()
    torch.testing.assert_close(posterior.variance(features), expected)


def test_output_scale_scales_the_variance_not_the_mean(
    transitions: Callable[[int], tuple[Tensor, ...]],
    predict: Callable[[CachedPosterior, Tensor], tuple[Tensor, Tensor]],
) -> None:
    data, z = transitions(10), torch.cat(transitions(9)[:2], dim=-1)
    results = []
    for scale in SCALES:
        gp = make("rbf ard", "simulator", scale=scale)
        gp.update(*data)
        results.append((*predict(gp.posterior, z), gp.posterior.noise_scale))
    (loc, variance, noise), (scaled_loc, scaled_variance, scaled_noise) = results
    torch.testing.assert_close(scaled_loc, loc, rtol=0, atol=1e-10)
    torch.testing.assert_close(scaled_variance, variance * SCALES["scaled"].double().square(), rtol=1e-9, atol=0)
    torch.testing.assert_close(scaled_noise, noise * SCALES["scaled"].double(), rtol=1e-9, atol=0)


class CountedPendulum(Pendulum):
    """Counts its steps."""

    calls = 0

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        self.calls += 1
        return super().step(state, action)


def test_one_simulator_call_serves_all_quantities(transitions: Callable[[int], tuple[Tensor, ...]]) -> None:
    pendulum = CountedPendulum(g=9.0, m=0.5, l=2.0)
    gp = DynamicsGP(EpisodicMean(SimulatorMean(pendulum)), KERNELS["rbf ard"]())
    gp.update(*transitions(5))
    gp.begin_episode()
    gp.update(*transitions(5))
    posterior, z = gp.posterior, torch.cat(transitions(9)[:2], dim=-1)
    base = pendulum(z[:, :2], z[:, 2:])
    pendulum.calls = 0
    features = posterior.features(z)
    assert pendulum.calls == 1
    results = [quantity(features) for quantity in (posterior.loc, posterior.prior_loc, posterior.scale)]
    known = posterior.features(z, simulator_loc=base, out=torch.empty(1, 9, 10, dtype=DOUBLE))
    for quantity, expected in zip((posterior.loc, posterior.prior_loc, posterior.scale), results, strict=True):
        torch.testing.assert_close(quantity(known), expected, rtol=0, atol=1e-14)
    assert pendulum.calls == 1


@pytest.mark.parametrize("change", [False, True])
def test_joined_features_are_those_of_all_points(
    change: bool, transitions: Callable[[int], tuple[Tensor, ...]]
) -> None:
    gp = make("rbf ard", "paper")
    gp.update(*transitions(5))
    gp.begin_episode()
    if change:
        change_hyperparameters(gp)
    gp.update(*transitions(5))
    posterior, z = gp.posterior, torch.cat(transitions(9)[:2], dim=-1)
    whole = posterior.features(z)
    joined = Features.join([posterior.features(part) for part in z.split(4)], z, whole.cross)
    assert (joined.outer is joined.simulator_loc) is not change
    for ours, expected in zip(joined, whole, strict=True):
        torch.testing.assert_close(ours, expected, rtol=0, atol=1e-14)


@pytest.mark.parametrize("kernel", ["rbf ard", "matern 5/2 ard", "product", "scale an output"])
def test_gradients_reach_the_points(kernel: str, transitions: Callable[[int], tuple[Tensor, ...]]) -> None:
    gp = make(kernel, "paper")
    for size in (5, 4):
        gp.begin_episode()
        gp.update(*transitions(size))
    z = torch.cat(transitions(3)[:2], dim=-1)
    z[:, 1] /= 2  # away from the speed limit
    posterior = gp.posterior
    for quantity in (posterior.loc, posterior.prior_loc, posterior.scale):
        assert torch.autograd.gradcheck(lambda z, q=quantity: q(posterior.features(z)), z.clone().requires_grad_())


def test_the_gradient_of_the_scale_is_finite_where_nothing_is_uncertain() -> None:
    gp = DynamicsGP(gpytorch.means.ZeroMean(batch_shape=TWO), LinearKernel(), state_space=Pendulum().state_space)
    z = torch.zeros(1, 3, dtype=DOUBLE, requires_grad=True)  # a linear kernel has no variance at zero
    posterior = gp.posterior
    scale = posterior.scale(posterior.features(z))
    scale.sum().backward()
    assert scale.abs().max() < 1e-100
    assert bool(torch.isfinite(z.grad).all())


@pytest.mark.parametrize("kernel", ["rbf ard", "product", "scale an output"])
def test_the_prior_covariance_is_the_kernel(kernel: str, generator: torch.Generator) -> None:
    gp = make(kernel, "simulator", scale="scaled")
    first, second = (
        torch.rand(4, 3, generator=generator, dtype=DOUBLE),
        torch.rand(5, 3, generator=generator, dtype=DOUBLE),
    )
    covariance = gp.posterior.prior_covariance(first, second)
    assert covariance.shape[-2:] == (4, 5)
    torch.testing.assert_close(covariance, gp.covar_module(first, second).to_dense())


def test_a_user_may_make_one_directly(generator: torch.Generator) -> None:
    """Rasmussen and Williams 2006, Eq. 2.25 and 2.26, written out."""
    z, query = torch.randn(2, 6, 3, generator=generator, dtype=DOUBLE)
    y = torch.randn(6, 2, generator=generator, dtype=DOUBLE)
    kernel, scale = RBFKernel().double(), torch.tensor([1.0, 3.0], dtype=DOUBLE)
    mean = gpytorch.means.ZeroMean(batch_shape=TWO)
    with torch.no_grad():
        posterior = CachedPosterior(mean, kernel, z, y, torch.tensor([0.1], dtype=DOUBLE), scale)
        cross, system = kernel(query, z).to_dense(), kernel(z).to_dense() + 0.1 * torch.eye(6, dtype=DOUBLE)
    features = posterior.features(query)
    torch.testing.assert_close(posterior.loc(features), cross @ torch.linalg.solve(system, y))
    unit = 1 - (cross * torch.linalg.solve(system, cross.mT).mT).sum(-1, keepdim=True)
    torch.testing.assert_close(posterior.variance(features), unit * scale.square())
    assert torch.equal(posterior.simulator_loc(query), torch.zeros(6, 2, dtype=DOUBLE))
