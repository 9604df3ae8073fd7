"""A small GP over the pendulum whose simulator counts its calls."""

from __future__ import annotations

from collections.abc import Callable

import gpytorch
import pytest
import torch
from tensordict import TensorDict
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


def random_points(num_points: int, generator: torch.Generator) -> TensorDict:
    pendulum = Pendulum()
    points = {
        "state": pendulum.state_space.sample((num_points,), generator),
        "action": pendulum.action_space.sample((num_points,), generator),
    }
    return TensorDict(points, [num_points])


def make_gp(num_points: int, generator: torch.Generator, output_scale: tuple[float, float] = (1.0, 1.0)) -> DynamicsGP:
    kernel = gpytorch.kernels.RBFKernel()
    kernel.lengthscale = 1.5
    gp = DynamicsGP(
        EpisodicMean(SimulatorMean(CountingPendulum(m=0.7))), kernel, output_scale=torch.tensor(output_scale)
    )
    if num_points:
        learn(gp, random_points(num_points, generator))
    return gp


def learn(gp: DynamicsGP, points: TensorDict) -> None:
    gp.update(points["state"], points["action"], Pendulum()(points["state"], points["action"]))


@pytest.fixture
def gp_with() -> Callable[..., DynamicsGP]:
    return make_gp


@pytest.fixture
def points_of() -> Callable[..., TensorDict]:
    return random_points


@pytest.fixture
def learn_from() -> Callable[..., None]:
    return learn
