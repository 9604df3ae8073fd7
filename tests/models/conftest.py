"""Data and models that the tests of this layer share."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from gpytorch.kernels import RBFKernel
from torch import Tensor

from torch_activegp.means import SimulatorMean
from torch_activegp.models import CachedPosterior, DynamicsGP
from torch_activegp.simulators import Pendulum

Transitions = tuple[Tensor, Tensor, Tensor]


@pytest.fixture
def prior() -> Pendulum:
    """The imperfect pendulum of the paper."""
    return Pendulum(g=9.0, m=0.5, l=2.0)


@pytest.fixture
def transitions(generator: torch.Generator) -> Callable[[int], Transitions]:
    """Draws transitions (state, action, next state) of the true pendulum."""
    truth = Pendulum()

    def draw(size: int) -> Transitions:
        state = truth.state_space.sample((size,), generator)
        action = truth.action_space.sample((size,), generator)
        return state, action, truth(state, action)

    return draw


@pytest.fixture
def gp(prior: Pendulum) -> DynamicsGP:
    """A GP about the imperfect pendulum, with length-scales in the units of the state."""
    kernel = RBFKernel(ard_num_dims=3).double()
    kernel.lengthscale = torch.tensor([[1.0, 4.0, 2.0]], dtype=torch.float64)
    return DynamicsGP(SimulatorMean(prior), kernel)


@pytest.fixture
def predict() -> Callable[[CachedPosterior, Tensor], tuple[Tensor, Tensor]]:
    """Mean and variance of a cached posterior, ``(n', d)`` each."""

    def evaluate(posterior: CachedPosterior, z: Tensor) -> tuple[Tensor, Tensor]:
        features = posterior.features(z)
        return posterior.loc(features), posterior.variance(features)

    return evaluate
