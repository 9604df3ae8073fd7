from __future__ import annotations

import gpytorch
import pytest
import torch

from torch_activegp.collectors import LargestErrorReductionStart
from torch_activegp.errors import ConfigurationError
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, FixedNoise, fit_output_scale
from torch_activegp.simulators import ActionSpace, FunctionSimulator, LocalBrake, Pendulum, StateSpace


def make_gp(num_points: int = 0, truth: Pendulum | None = None, seed: int = 0) -> DynamicsGP:
    kernel = gpytorch.kernels.RBFKernel(ard_num_dims=3)
    gp = DynamicsGP(EpisodicMean(SimulatorMean(Pendulum()), "bayes"), kernel, noise=FixedNoise(1e-3))
    kernel.lengthscale = torch.tensor([0.35, 1.2, 4.0], dtype=torch.float64)
    if num_points:
        truth, generator = truth or Pendulum(), torch.Generator().manual_seed(seed)
        state = truth.state_space.sample((num_points,), generator)
        action = truth.action_space.sample((num_points,), generator)
        gp.update(state, action, truth(state, action))
    return gp


def test_the_gain_is_the_weighted_variance_that_the_episode_removes(generator: torch.Generator) -> None:
    gp = make_gp(30, Pendulum(extra_torque=LocalBrake()))
    start = LargestErrorReductionStart(gp, Pendulum().action_space, episode_length=4, num_starts=6, num_references=50)
    posterior = gp.posterior
    references, points = posterior.features(start._sample(50)), start._sample(6)
    weight = start._weight(posterior, references)
    visited = start._roll_out(posterior, points)
    gain = start._gain(posterior, visited, references, weight)
    before = posterior.variance(references)[:, 0]
    for i in range(6):
        other = make_gp(30, Pendulum(extra_torque=LocalBrake()))
        z = visited.z.reshape(6, 4, 3)[i]
        other.update(z[:, :2], z[:, 2:], Pendulum()(z[:, :2], z[:, 2:]))  # the variance does not depend on the outcome
        after = other.posterior.variance(other.posterior.features(references.z))[:, 0]
        assert gain[i].item() == pytest.approx(((before - after) * weight).mean().item(), rel=1e-4)


def test_the_episode_follows_the_posterior_mean() -> None:
    gp = make_gp(30, Pendulum(extra_torque=LocalBrake()))
    start = LargestErrorReductionStart(gp, Pendulum().action_space, episode_length=3, num_starts=5)
    points = start._sample(5)
    z = start._roll_out(gp.posterior, points).z.reshape(5, 3, 3)
    torch.testing.assert_close(z[:, 0], points)
    for step in range(2):
        loc = gp.posterior.loc(gp.posterior.features(z[:, step]))
        space = Pendulum().state_space
        torch.testing.assert_close(z[:, step + 1, :2], space.wrap(loc).clamp(space.low, space.high))
        torch.testing.assert_close(z[:, step + 1, 2:], points[:, 2:])


def test_it_starts_near_the_place_where_the_simulator_was_seen_to_be_wrong() -> None:
    gp = make_gp(1000, Pendulum(extra_torque=LocalBrake(center=1.2)))
    fit_output_scale(gp)
    start = LargestErrorReductionStart(gp, Pendulum().action_space)
    angles = torch.stack([start()[0] for _ in range(8)])
    assert ((angles - 1.2).abs() < 1.0).double().mean() >= 0.75


def test_without_data_it_chooses_a_start_that_covers_much() -> None:
    start = LargestErrorReductionStart(make_gp(), Pendulum().action_space)
    state = start()
    assert state.shape == (2,)
    assert not torch.equal(state, start())  # fresh draws
    assert not torch.equal(state, LargestErrorReductionStart(make_gp(), Pendulum().action_space, seed=1)())


def test_its_state_dict_holds_the_generator_and_nothing_of_the_model() -> None:
    gp, actions = make_gp(10), Pendulum().action_space
    start = LargestErrorReductionStart(gp, actions)
    start()
    other = LargestErrorReductionStart(gp, actions, seed=5)
    other.load_state_dict(start.state_dict())
    assert torch.equal(start(), other())
    assert list(start.parameters()) == []


def test_errors_say_what_is_wrong() -> None:
    actions = Pendulum().action_space
    with pytest.raises(ConfigurationError, match="num_starts >= 1, found 0"):
        LargestErrorReductionStart(make_gp(), actions, num_starts=0)
    endless = StateSpace(["x"], -torch.inf, torch.inf)
    simulator = FunctionSimulator(lambda x, u: x + u, endless, ActionSpace(["u"], -1.0, 1.0), 0.1)
    gp = DynamicsGP(SimulatorMean(simulator), gpytorch.kernels.RBFKernel())
    with pytest.raises(ConfigurationError, match="finite bounds"):
        LargestErrorReductionStart(gp, simulator.action_space)
    batched = gpytorch.kernels.RBFKernel(batch_shape=torch.Size([2]))
    gp = DynamicsGP(SimulatorMean(Pendulum()), batched)
    with pytest.raises(ConfigurationError, match="one kernel and one relative noise"):
        LargestErrorReductionStart(gp, actions)()
