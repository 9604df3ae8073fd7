"""GPs over the pendulum, of any size, kernel and history, whose simulator counts its calls."""

from __future__ import annotations

from collections.abc import Callable

import gpytorch
import pytest
import torch
from gpytorch.kernels import Kernel, RBFKernel
from torch import Tensor

from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP
from torch_activegp.simulators import Pendulum


class CountingPendulum(Pendulum):
    """A pendulum that knows how often it was asked."""

    calls = 0

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        self.calls += 1
        return super().step(state, action)


def rbf(lengthscale: float = 1.5) -> RBFKernel:
    kernel = RBFKernel()
    kernel.lengthscale = lengthscale
    return kernel


def learn(gp: DynamicsGP, num_points: int, generator: torch.Generator) -> None:
    truth = Pendulum()
    state = truth.state_space.sample((num_points,), generator)
    action = truth.action_space.sample((num_points,), generator)
    gp.update(state, action, truth(state, action))


def make_gp(
    num_points: int = 0,
    generator: torch.Generator | None = None,
    kernel: Kernel | None = None,
    recursion: str = "paper",
) -> DynamicsGP:
    mean = EpisodicMean(SimulatorMean(CountingPendulum(m=0.7)), recursion=recursion)
    gp = DynamicsGP(mean, kernel or rbf(), likelihood=None, output_scale=torch.tensor([0.5, 2.0]))
    if num_points:
        learn(gp, num_points, generator or torch.Generator().manual_seed(7))
    return gp


def per_output_noise(generator: torch.Generator) -> DynamicsGP:
    likelihood = gpytorch.likelihoods.GaussianLikelihood(batch_shape=torch.Size([2]))
    likelihood.noise = torch.tensor([[1e-3], [1e-1]])
    gp = DynamicsGP(EpisodicMean(SimulatorMean(CountingPendulum(m=0.7))), rbf(), likelihood=likelihood)
    learn(gp, 12, generator)
    return gp


def per_output_kernel(generator: torch.Generator) -> DynamicsGP:
    kernel = RBFKernel(batch_shape=torch.Size([2]), ard_num_dims=3)
    kernel.lengthscale = torch.tensor([[[1.0, 2.0, 3.0]], [[0.5, 4.0, 1.0]]])
    return make_gp(12, generator, kernel)


def next_episode(generator: torch.Generator, recursion: str, new_lengthscale: float | None = None) -> DynamicsGP:
    gp = make_gp(8, generator, recursion=recursion)
    gp.begin_episode()
    if new_lengthscale:
        gp.covar_module.lengthscale = new_lengthscale
    learn(gp, 4, generator)
    return gp


HISTORIES: dict[str, Callable[[torch.Generator], DynamicsGP]] = {
    "no data": lambda generator: make_gp(0, generator),
    "10 points": lambda generator: make_gp(10, generator),
    "100 points": lambda generator: make_gp(100, generator),
    "Matern": lambda generator: make_gp(10, generator, gpytorch.kernels.MaternKernel(nu=1.5)),
    "any kernel": lambda generator: make_gp(10, generator, rbf() + gpytorch.kernels.PeriodicKernel()),
    "noise of each output": per_output_noise,
    "kernel of each output": per_output_kernel,
    "paper, episode 2": lambda generator: next_episode(generator, "paper"),
    "bayes, episode 2": lambda generator: next_episode(generator, "bayes"),
    "paper, new kernel": lambda generator: next_episode(generator, "paper", 0.8),
    "bayes, new kernel": lambda generator: next_episode(generator, "bayes", 0.8),
}


@pytest.fixture(params=HISTORIES)
def any_gp(request: pytest.FixtureRequest, generator: torch.Generator) -> DynamicsGP:
    return HISTORIES[request.param](generator)


@pytest.fixture
def gp_with() -> Callable[..., DynamicsGP]:
    return make_gp
