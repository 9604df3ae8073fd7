"""The corrected simulator of a black box, against the truth and against itself."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import torch
from scipy.integrate import solve_ivp

from torch_activegp.diagnosis.inputs.blackbox import BlackBox, accelerations
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.source import read_source
from torch_activegp.diagnosis.simulation.blackbox_simulator import AcceleratedSimulator, simulator_with
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.errors import SimulationError
from torch_activegp.simulators import FunctionSimulator, StateSpace


@pytest.fixture(scope="module")
def corrected(black) -> AcceleratedSimulator:
    box = BlackBox.of(black.simulator())
    return AcceleratedSimulator(*parts(black, box))


def parts(black, box):
    recordings = [black.record("none", 0)]
    machine = make_machine(box.model, recordings, recordings, box)
    effects = {e.name: e for e in accelerations(effects_for(box.model, machine.channels, machine.fit)) if not e.variant}
    values = (np.array([black.damping]), np.array([black.stiffness]))
    return box, machine.channels, Candidate((effects["viscous_friction"], effects["linear_spring"]), values)


def test_it_follows_the_truth_and_wraps_its_angle(black, corrected) -> None:
    actions = torch.linspace(-1.0, 3.0, 60).double()[:, None]
    x, wanted = np.array([0.4, 0.0]), []
    for u in actions[:, 0].tolist():
        slope = lambda _, s, u=u: [s[1], -9 * np.sin(s[0]) + 2 * u + black.law("viscous spring", *s)]  # noqa: E731
        x = solve_ivp(slope, (0.0, corrected.dt), x, rtol=1e-9, atol=1e-11).y[:, -1]
        wanted.append(x)
    states = corrected.rollout(torch.tensor([0.4, 0.0]).double(), actions)
    np.testing.assert_allclose(states, np.array(wanted), atol=2e-3)
    spinning = corrected.rollout(torch.tensor([3.0, 15.0]), actions[:20].float())
    assert spinning.dtype == torch.float32
    assert spinning[:, 0].abs().max() <= np.pi


def test_steps_and_rollouts_agree_in_any_batch(corrected) -> None:
    state, actions = torch.randn(3, 1, 2).double(), torch.randn(3, 4, 5, 1).double()
    states = corrected.rollout(state, actions)
    assert states.shape == (3, 4, 5, 2)
    current = state.expand(3, 4, 2)
    for k in range(5):
        current = corrected(current, actions[:, :, k])
        torch.testing.assert_close(current, states[:, :, k])
    assert corrected.rollout(state, actions[:, :, :0]).shape == (3, 4, 0, 2)


def test_actions_are_held_within_their_bounds(corrected) -> None:
    state = torch.zeros(2).double()
    torch.testing.assert_close(corrected(state, torch.tensor([50.0])), corrected(state, torch.tensor([5.0])))


def test_the_order_of_the_state_is_that_of_the_nominal(black, corrected) -> None:
    inner = black.simulator()
    space = StateSpace(["qvel.theta", "qpos.theta"], -np.inf, np.inf, angles=[1])
    turned = FunctionSimulator(lambda x, u: inner.step(x.flip(-1), u).flip(-1), space, inner.action_space, inner.dt)
    other = AcceleratedSimulator(*parts(black, BlackBox.of(turned)))
    state, action = torch.tensor([0.4, 1.0]).double(), torch.tensor([0.3]).double()
    torch.testing.assert_close(other(state.flip(-1), action).flip(-1), corrected(state, action))


def test_a_copy_steps_alike_and_gradients_are_refused(corrected) -> None:
    state, action = torch.tensor([0.4, 1.0]).double(), torch.tensor([0.3]).double()
    torch.testing.assert_close(copy.deepcopy(corrected)(state, action), corrected(state, action))
    with pytest.raises(SimulationError, match="requires a gradient"):
        corrected(state.requires_grad_(), action)


def test_it_can_be_diagnosed_again(corrected) -> None:
    box = BlackBox.of(corrected)
    state, action = torch.tensor([[0.4, 1.0]]).double(), torch.tensor([[0.3]]).double()
    np.testing.assert_allclose(box.step(state.numpy(), action.numpy()), corrected(state, action), atol=1e-12)


def test_without_effects_it_is_the_nominal(black, bench) -> None:
    simulator = black.simulator()
    source = read_source(simulator)
    channels = parts(black, source.box)[1]
    assert simulator_with(source, channels, NOMINAL, None) is simulator
    made = simulator_with(source, *parts(black, source.box)[1:], None)
    assert isinstance(made, AcceleratedSimulator)
    plain = simulator_with(read_source(bench.xml), bench.machine.channels, Candidate(), bench.xml)
    assert plain.state_space.names == ("qpos.hip", "qvel.hip")
