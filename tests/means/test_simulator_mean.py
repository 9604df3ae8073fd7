"""The simulator as a gpytorch mean."""

from __future__ import annotations

import copy
import pickle

import pytest
import torch

from torch_activegp.errors import ShapeError
from torch_activegp.means import SimulatorMean
from torch_activegp.simulators import FunctionSimulator, Pendulum

DOUBLE = torch.float64
PRIOR = {"g": 9.0, "m": 0.5, "l": 2.0}


def inputs(size: int, generator: torch.Generator) -> torch.Tensor:
    pendulum = Pendulum()
    state = pendulum.state_space.sample((size,), generator)
    return torch.cat([state, pendulum.action_space.sample((size,), generator)], dim=-1)


def test_it_is_the_simulators_next_state_in_both_layouts(generator: torch.Generator) -> None:
    simulator = Pendulum(**PRIOR)
    mean, z = SimulatorMean(simulator), inputs(7, generator)
    expected = simulator(z[:, :2], z[:, 2:])
    assert torch.equal(mean.predict(z), expected)
    assert torch.equal(mean(z), expected.mT)
    assert torch.equal(mean(z.expand(2, -1, -1)), expected.mT)
    assert torch.equal(mean(z.expand(4, 2, -1, -1)), expected.mT.expand(4, -1, -1))
    assert torch.equal(mean.predict(z.reshape(7, 1, 3)), expected.reshape(7, 1, 2))
    assert mean.batch_shape == (2,)
    assert mean.state_space is simulator.state_space


def test_each_output_may_have_its_own_inputs(generator: torch.Generator) -> None:
    simulator = Pendulum(**PRIOR)
    x = torch.stack([inputs(5, generator), inputs(5, generator)])
    values = SimulatorMean(simulator)(x)
    for output in range(2):
        assert torch.equal(values[output], simulator(x[output, :, :2], x[output, :, 2:])[:, output])


def test_it_keeps_float32(generator: torch.Generator) -> None:
    mean = SimulatorMean(Pendulum()).to(torch.float32)
    assert mean(inputs(4, generator).to(torch.float32)).dtype == torch.float32


def test_a_wrong_number_of_columns_is_refused() -> None:
    with pytest.raises(ShapeError, match=r"Wanted 3 columns \(2 states, 1 actions\), found 4\. Concatenate"):
        SimulatorMean(Pendulum())(torch.zeros(5, 4, dtype=DOUBLE))


def test_gradients_reach_the_simulators_parameters(generator: torch.Generator) -> None:
    z = inputs(6, generator)
    z[:, 1].clamp_(-4.0, 4.0)  # away from the speed limit, where there is no gradient

    def prediction(g: torch.Tensor, m: torch.Tensor, l: torch.Tensor) -> torch.Tensor:  # noqa: E741
        mean = SimulatorMean(Pendulum(trainable=True))
        values = {"simulator.g": g, "simulator.m": m, "simulator.l": l}
        return torch.func.functional_call(mean, values, (z,))

    parameters = [torch.tensor(value, dtype=DOUBLE, requires_grad=True) for value in PRIOR.values()]
    assert torch.autograd.gradcheck(prediction, parameters)


def test_trainable_parameters_are_the_means_own() -> None:
    mean = SimulatorMean(Pendulum(trainable=True))
    assert {name for name, _ in mean.named_parameters()} == {"simulator.g", "simulator.m", "simulator.l"}
    mean(torch.ones(3, 3, dtype=DOUBLE)).sum().backward()
    assert all(parameter.grad is not None for parameter in mean.parameters())


def test_state_dict_pickle_and_deepcopy_keep_the_numbers(generator: torch.Generator) -> None:
    mean, z = SimulatorMean(Pendulum(**PRIOR)), inputs(5, generator)
    fresh = SimulatorMean(Pendulum())
    assert not torch.equal(fresh(z), mean(z))
    fresh.load_state_dict(mean.state_dict())
    for other in (fresh, pickle.loads(pickle.dumps(mean)), copy.deepcopy(mean)):
        assert torch.equal(other(z), mean(z))


def test_any_function_serves_as_a_mean(generator: torch.Generator) -> None:
    mean = SimulatorMean(FunctionSimulator(lambda state, action: state + 0.1 * action, 2, 2, dt=0.1))
    z = torch.rand(5, 4, generator=generator, dtype=DOUBLE)
    torch.testing.assert_close(mean(z), (z[:, :2] + 0.1 * z[:, 2:]).mT)
