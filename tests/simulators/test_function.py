from __future__ import annotations

import copy
import math
import pickle

import pytest
import torch
from torch import Tensor, nn

from torch_activegp.errors import ConfigurationError, SimulationError
from torch_activegp.simulators.function import FunctionSimulator
from torch_activegp.simulators.space import ActionSpace, StateSpace


class Linear(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        self.gain = nn.Parameter(torch.tensor(0.5, dtype=torch.float64))

    def forward(self, state: Tensor, action: Tensor) -> Tensor:
        return state + self.gain * action


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_a_function_fits_in_one_line(dtype: torch.dtype, batch: tuple[int, ...]) -> None:
    simulator = FunctionSimulator(lambda state, action: state + 0.1 * action, 2, 1, dt=0.1)
    after = simulator(torch.ones(*batch, 2, dtype=dtype), torch.ones(1, dtype=dtype))
    assert (after.shape, after.dtype) == ((*batch, 2), dtype)
    torch.testing.assert_close(after, torch.full_like(after, 1.1))
    assert simulator.state_space.names == ("state0", "state1")
    assert simulator.action_space.names == ("action0",)
    assert simulator.state_space.low.tolist() == [-math.inf] * 2


def test_angles_of_the_result_are_wrapped() -> None:
    space = StateSpace(["theta"], -math.pi, math.pi, angles=[0])
    simulator = FunctionSimulator(lambda state, action: state + action, space, ActionSpace(["u"], -1.0, 1.0), dt=0.1)
    assert simulator(torch.tensor([3.0]), torch.tensor([1.0])).item() == pytest.approx(4.0 - 2 * math.pi, abs=1e-6)


def test_parameters_and_gradients_of_a_module_come_along() -> None:
    simulator = FunctionSimulator(Linear(), 1, 1, dt=0.1)
    simulator(torch.zeros(1).double(), torch.full((1,), 3.0).double()).backward()
    assert [parameter.grad.item() for parameter in simulator.parameters()] == [3.0]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda simulator: pickle.loads(pickle.dumps(simulator))])
def test_copies_and_state_dicts_behave_alike(copied) -> None:
    simulator, other = FunctionSimulator(Linear(), 1, 1, dt=0.1), FunctionSimulator(Linear(), 1, 1, dt=0.1)
    simulator.fn.gain.data.fill_(0.25)
    other.load_state_dict(simulator.state_dict())
    for twin in (copied(simulator), other):
        assert twin(torch.zeros(1), torch.ones(1)).item() == 0.25


def bad_shape(state: Tensor, action: Tensor) -> Tensor:
    return torch.zeros(3)


@pytest.mark.parametrize(
    ("fn", "message"),
    [
        (bad_shape, r"wanted the next states \(5, 2\) from `bad_shape`.*found shape \(3,\)"),
        (lambda state, action: state[0], r"\(5, 2\).*found shape \(2,\)"),
        (lambda state, action: None, "found a NoneType"),
    ],
)
def test_a_wrong_result_is_named(fn, message: str) -> None:
    with pytest.raises(SimulationError, match=message):
        FunctionSimulator(fn, 2, 1, dt=0.1)(torch.zeros(5, 2), torch.zeros(5, 1))


def test_the_time_step_must_be_positive() -> None:
    with pytest.raises(ConfigurationError, match="dt"):
        FunctionSimulator(Linear(), 1, 1, dt=0.0)
