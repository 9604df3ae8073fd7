from __future__ import annotations

import pickle
import re
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from torch_activegp.errors import SimulationError
from torch_activegp.experiments.user_simulator import UserSimulator, name_of, require_finite
from torch_activegp.simulators import ActionSpace, FunctionSimulator, Pendulum, Simulator, StateSpace

STATES, ACTIONS = StateSpace(["x", "v"], -1.0, 1.0), ActionSpace(["u"], -1.0, 1.0)


class Unchecked(Simulator):
    def __init__(self, fn: Callable[[Tensor, Tensor], object]) -> None:
        super().__init__(STATES, ACTIONS, 0.1)
        self.fn = fn

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        return self.fn(state, action)


@pytest.mark.parametrize("batch", [(), (5,), (3, 4)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_sound_simulator_is_left_alone(batch: tuple[int, ...], dtype: torch.dtype) -> None:
    pendulum = Pendulum()
    state, action = torch.rand(*batch, 2, dtype=dtype), torch.rand(*batch, 1, dtype=dtype)
    watched = UserSimulator(pendulum, "mine:make")
    assert torch.equal(watched(state, action), pendulum(state, action))
    assert (watched.dt, watched.state_space, watched.action_space) == (
        pendulum.dt,
        pendulum.state_space,
        pendulum.action_space,
    )
    copy = pickle.loads(pickle.dumps(watched))
    copy.load_state_dict(watched.state_dict())
    assert torch.equal(copy(state, action), pendulum(state, action))


def test_gradients_pass_through() -> None:
    watched = UserSimulator(Pendulum(trainable=True), "mine:make")
    watched(torch.ones(2), torch.ones(1)).sum().backward()
    assert all(parameter.grad is not None for parameter in watched.parameters())


@pytest.mark.parametrize(
    ("fn", "message"),
    [
        (lambda s, a: s[..., :1], r"`mine:make` returned shape \(7, 1\) for states \(7, 2\).*wanted \(7, 2\)"),
        (lambda s, a: (s, a), "`mine:make` returned tuple for"),
        (lambda s, a: s[:, 5], "`mine:make` failed for states .*: IndexError: index 5"),
        (lambda s, a: {}["gain"], "KeyError: 'gain'"),
        (lambda s, a: 1 / 0, "ZeroDivisionError"),
    ],
)
def test_a_fault_is_reported_with_the_simulators_name(fn: Callable[[Tensor, Tensor], object], message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        UserSimulator(Unchecked(fn), "mine:make").step(torch.zeros(7, 2), torch.zeros(7, 1))


def test_our_own_errors_keep_their_words() -> None:
    simulator = UserSimulator(FunctionSimulator(lambda s, a: s[..., :1], STATES, ACTIONS, 0.1), "mine:make")
    with pytest.raises(SimulationError, match=r"`mine:make` failed for .*: FunctionSimulator: wanted the next states"):
        simulator(torch.zeros(2), torch.zeros(1))


def test_a_nan_is_reported_with_state_and_action_unless_it_may_be() -> None:
    spoilt = Unchecked(lambda s, a: torch.where(s > 0.5, torch.nan, s))
    states, action = torch.tensor([[0.0, 0.0], [0.25, 0.75]]), torch.tensor([0.125])
    message = re.escape("`mine:make` returned [0.25, nan] from state {'x': 0.25, 'v': 0.75} under action {'u': 0.125}.")
    with pytest.raises(SimulationError, match=message):
        UserSimulator(spoilt, "mine:make").step(states, action)
    assert torch.isnan(UserSimulator(spoilt, "mine:make", finite=False).step(states, action)[1, 1])


def test_other_simulators_go_by_their_class() -> None:
    assert name_of(Pendulum()) == "Pendulum"
    assert name_of(UserSimulator(Pendulum(), "mine:make")) == "mine:make"
    with pytest.raises(SimulationError, match=r"`Pendulum` returned \[inf, 0.0\].*--bounds NAME=LOW:HIGH"):
        require_finite(Pendulum(), torch.tensor([torch.inf, 0.0]), torch.zeros(2), torch.zeros(1))
