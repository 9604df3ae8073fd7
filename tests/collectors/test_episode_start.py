from __future__ import annotations

import gpytorch
import pytest
import torch
from torch import Tensor

from torch_activegp.collectors import EpisodeCollector, EpisodeStart
from torch_activegp.collectors.episode_start import bounded_box, state_space_of
from torch_activegp.envs import SimulatorEnv
from torch_activegp.errors import ConfigurationError
from torch_activegp.means import SimulatorMean
from torch_activegp.models import DynamicsGP
from torch_activegp.simulators import ActionSpace, Pendulum, StateSpace


class RandomStart(EpisodeStart):
    """A rule of a user's own: anywhere in the box."""

    def forward(self) -> Tensor:
        unit = torch.rand(len(self.low), generator=self.generator, dtype=torch.float64)
        return torch.lerp(self.low, self.high, unit)[: self.state_space.dim]


def make_gp() -> DynamicsGP:
    return DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel())


def test_a_rule_of_ones_own_starts_episodes() -> None:
    env = SimulatorEnv(Pendulum())
    start, twin = (RandomStart(make_gp(), Pendulum().action_space, seed=3) for _ in range(2))
    episode = EpisodeCollector(env, env.rand_action, 2, start=start).collect()
    torch.testing.assert_close(episode["state"][0], twin())


def test_a_restored_rule_goes_on_where_the_first_one_stood_and_owns_nothing_of_the_model() -> None:
    first, second = (RandomStart(make_gp(), Pendulum().action_space, seed=seed) for seed in (0, 1))
    first()
    second.load_state_dict(first.state_dict())
    assert torch.equal(first(), second())
    assert list(first.parameters()) == []


def test_what_it_needs_is_asked_for() -> None:
    with pytest.raises(TypeError, match="abstract"):
        EpisodeStart(make_gp(), Pendulum().action_space, seed=0)
    zero = gpytorch.means.ZeroMean(batch_shape=torch.Size([1]))
    with pytest.raises(ConfigurationError, match="no state space"):
        state_space_of(DynamicsGP(zero, gpytorch.kernels.RBFKernel()))
    with pytest.raises(ConfigurationError, match="finite bounds"):
        bounded_box(StateSpace(["x"], -torch.inf, torch.inf), ActionSpace(["u"], -1.0, 1.0))
