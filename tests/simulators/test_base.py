from __future__ import annotations

import pytest
import torch
from torch import Tensor

from torch_activegp.errors import ConfigurationError, ShapeError
from torch_activegp.simulators.base import Simulator
from torch_activegp.simulators.space import ActionSpace, StateSpace


class Integrator(Simulator):
    """x' = x + dt u, the plainest simulator."""

    def __init__(self, dt: float = 0.5) -> None:
        super().__init__(StateSpace(["x", "y"], -1.0, 1.0), ActionSpace(["u", "v"], -1.0, 1.0), dt)

    def step(self, state: Tensor, action: Tensor) -> Tensor:
        return state + self.dt * action


def test_sizes_come_from_the_spaces() -> None:
    simulator = Integrator()
    assert (simulator.state_dim, simulator.action_dim, simulator.dt) == (2, 2, 0.5)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(
    ("state_batch", "action_batch", "batch"),
    [((), (), ()), ((3,), (3,), (3,)), ((4, 1), (3,), (4, 3)), ((), (5,), (5,))],
)
def test_rollout_is_the_repeated_step(dtype, state_batch, action_batch, batch) -> None:
    generator = torch.Generator().manual_seed(0)
    state = torch.randn(*state_batch, 2, generator=generator, dtype=dtype)
    actions = torch.randn(*action_batch, 4, 2, generator=generator, dtype=dtype)
    states = Integrator().rollout(state, actions)
    assert (states.shape, states.dtype) == ((*batch, 4, 2), dtype)
    expected = state.unsqueeze(-2) + 0.5 * actions.cumsum(-2)
    torch.testing.assert_close(states, expected)
    torch.testing.assert_close(Integrator()(state, actions[..., 0, :]), expected[..., 0, :])


def test_rollout_of_no_action_is_empty() -> None:
    assert Integrator().rollout(torch.zeros(3, 2), torch.zeros(3, 0, 2)).shape == (3, 0, 2)


def test_gradients_flow_through_a_rollout() -> None:
    actions = torch.zeros(3, 2, requires_grad=True)
    Integrator().rollout(torch.zeros(2), actions)[-1].sum().backward()
    assert actions.grad is not None
    assert torch.equal(actions.grad, torch.full((3, 2), 0.5))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s(torch.zeros(3), torch.zeros(2)), r"Integrator: wanted state \(..., 2\) with \['x', 'y'\].*\(3,\)"),
        (lambda s: s(torch.zeros(2), torch.zeros(1)), r"wanted action \(..., 2\).*\(1,\)"),
        (lambda s: s(torch.tensor(0.0), torch.zeros(2)), r"wanted state .*\(\)"),
        (lambda s: s(torch.zeros(3, 2), torch.zeros(4, 2)), r"state \(3,\) and action \(4,\) do not broadcast"),
        (lambda s: s.rollout(torch.zeros(2), torch.zeros(2)), r"wanted actions \(..., T, 2\).*unsqueeze"),
        (lambda s: s.rollout(torch.zeros(3, 2), torch.zeros(4, 5, 2)), "do not broadcast"),
        (lambda s: s.rollout(torch.zeros(2), torch.zeros(5, 3)), "wanted action"),
    ],
)
def test_wrong_shapes_are_named(call, message: str) -> None:
    with pytest.raises(ShapeError, match=message):
        call(Integrator())


@pytest.mark.parametrize("dt", [0.0, -0.1, float("inf"), float("nan")])
def test_the_time_step_must_be_positive(dt: float) -> None:
    with pytest.raises(ConfigurationError, match="time step `dt` > 0 s"):
        Integrator(dt)
