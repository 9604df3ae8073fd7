from __future__ import annotations

import copy
import math
import pickle

import pytest
import torch
from scipy.integrate import solve_ivp
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.integrators import rk4, semi_implicit_euler
from torch_activegp.simulators.ode import OdeSimulator
from torch_activegp.simulators.space import ActionSpace, StateSpace


class Rod(nn.Module):
    """theta'' = -k sin(theta) + u."""

    def __init__(self) -> None:
        super().__init__()
        self.k = nn.Parameter(torch.tensor(5.0, dtype=torch.float64))

    def forward(self, state: Tensor, action: Tensor) -> Tensor:
        theta, speed = state.chunk(2, -1)
        return torch.cat((speed, action - self.k * torch.sin(theta)), -1)


def rod(**options) -> OdeSimulator:
    space = StateSpace(["theta", "speed"], [-math.pi, -9.0], [math.pi, 9.0], angles=[0])
    return OdeSimulator(Rod(), space, ActionSpace(["u"], -2.0, 2.0), dt=0.05, **options)


@pytest.mark.parametrize(("integrator", "substeps", "tolerance"), [(rk4, 1, 1e-5), (semi_implicit_euler, 400, 5e-3)])
def test_a_rollout_agrees_with_scipy_and_wraps_the_angle(integrator, substeps: int, tolerance: float) -> None:
    actions = torch.tensor([[1.5], [-1.0], [0.5], [2.0]] * 2, dtype=torch.float64)
    states = rod(integrator=integrator, substeps=substeps).rollout(
        torch.tensor([2.9, 4.0], dtype=torch.float64), actions
    )
    exact = [2.9, 4.0]
    for row, action in zip(states, actions, strict=True):
        solution = solve_ivp(
            lambda _, x, u: [x[1], u - 5.0 * math.sin(x[0])], (0, 0.05), exact, args=(action.item(),), rtol=1e-10
        )
        exact = solution.y[:, -1].tolist()
        wrapped = [math.remainder(exact[0], 2 * math.pi), exact[1]]
        assert row.tolist() == pytest.approx(wrapped, abs=tolerance)
    assert exact[0] > math.pi  # the wrap was put to the test


def test_substeps_reduce_the_error() -> None:
    state, action = torch.tensor([1.0, 1.0], dtype=torch.float64), torch.zeros(1, dtype=torch.float64)
    fine = rod(substeps=1000)(state, action)
    coarse, finer = ((rod(integrator=semi_implicit_euler, substeps=n)(state, action) - fine).norm() for n in (1, 8))
    assert finer < coarse / 6


def test_actions_are_clipped_to_their_bounds() -> None:
    state = torch.zeros(2, dtype=torch.float64)
    outside, edge = (rod()(state, torch.tensor([u], dtype=torch.float64)) for u in (50.0, 2.0))
    assert torch.equal(outside, edge)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_shape_and_dtype_stay(dtype: torch.dtype, batch: tuple[int, ...]) -> None:
    after = rod()(torch.ones(*batch, 2, dtype=dtype), torch.ones(1, dtype=dtype))
    assert (after.shape, after.dtype) == ((*batch, 2), dtype)


def test_parameters_of_a_module_can_be_fitted() -> None:
    simulator = rod()
    assert [name for name, _ in simulator.named_parameters()] == ["dynamics.k"]
    states = simulator.rollout(torch.tensor([1.0, 0.0], dtype=torch.float64), torch.zeros(10, 1, dtype=torch.float64))
    states[-1, 0].backward()
    gradient = simulator.dynamics.k.grad.item()
    ends = []
    for shift in (1e-5, -1e-5):
        other = rod()
        other.dynamics.k.data += shift
        with torch.no_grad():
            ends.append(other.rollout(torch.tensor([1.0, 0.0]).double(), torch.zeros(10, 1).double())[-1, 0].item())
    assert gradient == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-6)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda simulator: pickle.loads(pickle.dumps(simulator))])
def test_copies_and_state_dicts_behave_alike(copied) -> None:
    simulator = rod(integrator=semi_implicit_euler)
    simulator.dynamics.k.data.fill_(3.0)
    state, action = torch.tensor([1.0, 1.0]).double(), torch.zeros(1).double()
    other = rod(integrator=semi_implicit_euler)
    other.load_state_dict(simulator.state_dict())
    for twin in (copied(simulator), other):
        assert torch.equal(twin(state, action), simulator(state, action))


def test_no_substep_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="`substeps` >= 1, found 0"):
        rod(substeps=0)
