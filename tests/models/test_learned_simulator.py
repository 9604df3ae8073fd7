"""The learned model is a simulator again."""

from __future__ import annotations

import math
from collections.abc import Callable

import gpytorch
import pytest
import torch
from gpytorch.kernels import RBFKernel
from torch import Tensor

from torch_activegp.errors import ConfigurationError, ShapeError
from torch_activegp.means import SimulatorMean
from torch_activegp.models import DynamicsGP, LearnedSimulator
from torch_activegp.simulators import Pendulum

DOUBLE = torch.float64
Draw = Callable[[int], tuple[Tensor, Tensor, Tensor]]


def learned(gp: DynamicsGP, prior: Pendulum, trust: list[float] | None = None) -> LearnedSimulator:
    return LearnedSimulator(gp, prior.action_space, prior.dt, None if trust is None else torch.tensor(trust))


def test_it_steps_with_the_posterior_mean_on_the_circle(gp: DynamicsGP, prior: Pendulum, transitions: Draw) -> None:
    gp.update(*transitions(30))
    state, action, _ = transitions(9)
    state[0] = torch.tensor([math.pi - 1e-3, 4.0])  # steps over the seam
    simulator, features = learned(gp, prior), gp.posterior.features(torch.cat([state, action], dim=-1))
    assert torch.equal(simulator(state, action), gp.state_space.wrap(gp.posterior.loc(features)))
    assert simulator(state, action)[:, 0].abs().max() <= math.pi
    assert (simulator.state_dim, simulator.action_dim, simulator.dt) == (2, 1, prior.dt)


def test_it_predicts_better_than_the_simulator(gp: DynamicsGP, prior: Pendulum, transitions: Draw) -> None:
    gp.update(*transitions(60))
    state, action, truth = transitions(200)
    errors = [
        gp.state_space.difference(model(state, action), truth).square().mean() for model in (learned(gp, prior), prior)
    ]
    assert errors[0] < 0.1 * errors[1]


def test_without_trust_it_is_the_simulator_alone(gp: DynamicsGP, prior: Pendulum, transitions: Draw) -> None:
    gp.update(*transitions(30))
    state, action, _ = transitions(9)
    assert torch.equal(learned(gp, prior, [0.0, 0.0])(state, action), prior(state, action))
    half = learned(gp, prior, [0.0, 0.5])(state, action)
    assert torch.equal(half[:, 0], prior(state, action)[:, 0])
    middle = (prior(state, action) + learned(gp, prior)(state, action))[:, 1] / 2
    torch.testing.assert_close(half[:, 1], middle, rtol=0, atol=1e-12)


def test_it_rolls_out_and_broadcasts(gp: DynamicsGP, prior: Pendulum, transitions: Draw) -> None:
    gp.update(*transitions(30))
    simulator = learned(gp, prior)
    state, actions = transitions(1)[0][0], torch.linspace(-1, 1, 12, dtype=DOUBLE).reshape(3, 4, 1)
    path = simulator.rollout(state, actions)
    assert path.shape == (3, 4, 2)
    current = state.expand(3, 2)
    for step in range(4):
        current = simulator(current, actions[:, step])
        torch.testing.assert_close(path[:, step], current, rtol=0, atol=1e-12)
    assert simulator(state.float(), actions[:, 0].float()).dtype == torch.float32


def test_it_can_be_the_mean_of_another_gp(gp: DynamicsGP, prior: Pendulum, transitions: Draw) -> None:
    gp.update(*transitions(30))
    second = DynamicsGP(SimulatorMean(learned(gp, prior)), RBFKernel())
    second.update(*transitions(5))
    z = torch.cat(transitions(6)[:2], dim=-1)
    kept = second.posterior
    features = kept.features(z)
    torch.testing.assert_close(second(z).mean.mT.detach(), kept.loc(features), rtol=0, atol=1e-8)
    gp.update(*transitions(5))  # the inner model learns: the outer one notices
    assert second.posterior is not kept
    fresh = DynamicsGP(
        SimulatorMean(learned(DynamicsGP(SimulatorMean(prior), RBFKernel(ard_num_dims=3)), prior)), RBFKernel()
    )
    fresh.load_state_dict(second.state_dict())
    outputs = [model.posterior.loc(model.posterior.features(z)) for model in (second, fresh)]
    torch.testing.assert_close(outputs[1], outputs[0], rtol=0, atol=1e-10)


def test_gradients_reach_the_state(gp: DynamicsGP, prior: Pendulum, transitions: Draw) -> None:
    gp.update(*transitions(10))
    state, action, _ = transitions(3)
    assert torch.autograd.gradcheck(learned(gp, prior), ((state / 2).requires_grad_(), (action / 2).requires_grad_()))


def test_what_it_needs(gp: DynamicsGP, prior: Pendulum) -> None:
    with pytest.raises(ShapeError, match=r"Wanted trust of shape \(2,\), found \(3,\)"):
        learned(gp, prior, [1.0, 1.0, 1.0])
    bare = DynamicsGP(gpytorch.means.ZeroMean(batch_shape=torch.Size([2])), RBFKernel())
    with pytest.raises(ConfigurationError, match=r"GP with a state space\. Pass DynamicsGP\(\.\.\., state_space"):
        learned(bare, prior)
