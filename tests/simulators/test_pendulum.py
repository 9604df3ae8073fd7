from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest
import torch
from gymnasium.envs.classic_control.pendulum import PendulumEnv
from scipy.integrate import solve_ivp
from torch import nn

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.integrators import rk4
from torch_activegp.simulators.local_torques import LocalBrake, Magnet
from torch_activegp.simulators.pendulum import Pendulum

DOUBLE = torch.float64


def random_batch(pendulum: Pendulum, size: int = 64, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return pendulum.state_space.sample((size,), generator), 1.5 * pendulum.action_space.sample((size,), generator)


def test_it_is_gymnasiums_pendulum_step_by_step() -> None:
    env = PendulumEnv(g=9.81)
    env.reset(seed=0)
    pendulum = Pendulum(equation="gymnasium")
    state = torch.tensor([0.0, 7.9], dtype=DOUBLE)
    env.state = state.numpy()
    clipped = 0
    for action in torch.empty(400, 1, dtype=DOUBLE).uniform_(0.0, 4.0, generator=torch.Generator().manual_seed(1)):
        env.step(action.numpy())
        state = pendulum(state, action)
        turned = np.array([math.remainder(env.state[0], 2 * math.pi), env.state[1]])
        np.testing.assert_allclose(state.numpy(), turned, atol=1e-9)
        clipped += abs(env.state[1]) == 8.0
    assert clipped > 20  # the speed limit was put to the test
    assert pendulum.dt == env.dt
    assert pendulum.state_space.high[1] == env.max_speed
    assert pendulum.action_space.high[0] == env.max_torque


@pytest.mark.parametrize("parameters", [{}, {"g": 9.0, "m": 0.5, "l": 2.0}])
def test_the_papers_equation_is_the_printed_one(parameters: dict[str, float]) -> None:
    pendulum = Pendulum(**parameters)
    (theta, speed), torque = random_batch(pendulum)[0].unbind(-1), random_batch(pendulum)[1][:, 0]
    g, m, l = (parameters.get(name, default) for name, default in (("g", 9.81), ("m", 1.0), ("l", 1.0)))  # noqa: E741
    acceleration = pendulum.acceleration(theta, speed, torque)
    torch.testing.assert_close(m * l**2 * acceleration + 3 * m * g * l * torch.sin(theta), 3 * torque)


def test_angle_zero_hangs_in_the_paper_and_stands_in_gymnasium() -> None:
    state, action = torch.tensor([0.1, 0.0], dtype=DOUBLE), torch.zeros(1, dtype=DOUBLE)
    assert Pendulum()(state, action)[1] < 0
    assert Pendulum(equation="gymnasium")(state, action)[1] > 0


@pytest.mark.parametrize("equation", ["paper", "gymnasium"])
def test_rk4_agrees_with_scipy(equation: str) -> None:
    pendulum = Pendulum(equation=equation, integrator=rk4, extra_torque=Magnet())
    weight = -3 * 9.81 if equation == "paper" else 1.5 * 9.81

    def derivative(_: float, x: np.ndarray) -> list[float]:
        offset = (x[0] - 1.2) / 0.25
        return [x[1], weight * math.sin(x[0]) + 3 * (0.7 - offset * math.exp(0.5 - 0.5 * offset**2))]

    exact = solve_ivp(derivative, (0, 0.05), [1.0, 0.5], rtol=1e-10).y[:, -1]
    after = pendulum(torch.tensor([1.0, 0.5], dtype=DOUBLE), torch.tensor([0.7], dtype=DOUBLE))
    np.testing.assert_allclose(after.numpy(), exact, atol=2e-4)


@pytest.mark.parametrize("integrator", [None, rk4])
def test_torque_and_speed_are_clipped_and_the_angle_wrapped(integrator) -> None:
    pendulum = Pendulum() if integrator is None else Pendulum(integrator=integrator)
    state = torch.tensor([3.1, 8.0], dtype=DOUBLE)
    outside, edge = (pendulum(state, torch.tensor([u], dtype=DOUBLE)) for u in (90.0, 2.0))
    assert torch.equal(outside, edge)
    assert outside[1] == 8.0
    assert outside[0] == pytest.approx(3.5 - 2 * math.pi, abs=1e-12 if integrator is None else 0.02)


@pytest.mark.parametrize("integrator", [None, rk4])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(
    ("state_batch", "action_batch", "batch"), [((), (), ()), ((), (3,), (3,)), ((2, 1), (3,), (2, 3))]
)
def test_batches_broadcast_and_dtypes_stay(integrator, dtype, state_batch, action_batch, batch) -> None:
    pendulum = Pendulum() if integrator is None else Pendulum(integrator=integrator)
    after = pendulum(torch.ones(*state_batch, 2, dtype=dtype), torch.ones(*action_batch, 1, dtype=dtype))
    assert (after.shape, after.dtype) == ((*batch, 2), dtype)


def test_each_sample_is_stepped_by_itself() -> None:
    pendulum = Pendulum(extra_torque=LocalBrake())
    state, action = random_batch(pendulum)
    state[7] = math.nan
    together = pendulum(state, action)
    alone = torch.stack([pendulum(x, u) for x, u in zip(state, action, strict=True)])
    torch.testing.assert_close(together, alone, equal_nan=True)
    assert together.isnan().any(-1).nonzero().tolist() == [[7]]


def test_parameters_are_buffers_unless_wanted() -> None:
    shared = nn.Parameter(torch.tensor(0.5, dtype=DOUBLE))
    assert not list(Pendulum().parameters())
    assert set(dict(Pendulum(trainable=True).named_parameters())) == {"g", "m", "l"}
    mixed = Pendulum(m=shared)
    assert list(mixed.parameters()) == [shared]
    assert mixed.m is shared


@pytest.mark.parametrize("integrator", [None, rk4])
@pytest.mark.parametrize("equation", ["paper", "gymnasium"])
def test_gradients_reach_state_action_and_parameters(integrator, equation: str) -> None:
    options = {} if integrator is None else {"integrator": integrator}
    parameters = [torch.tensor(value, dtype=DOUBLE, requires_grad=True) for value in (9.0, 0.8, 1.3)]
    state = torch.tensor([[0.3, -1.0], [2.0, 0.5]], dtype=DOUBLE, requires_grad=True)
    action = torch.tensor([[0.5], [-1.0]], dtype=DOUBLE, requires_grad=True)
    pendulum = Pendulum(equation=equation, extra_torque=LocalBrake(), **options)

    def step(x, u, g, m, l):  # noqa: E741
        return torch.func.functional_call(pendulum, {"g": g, "m": m, "l": l}, (x, u))

    assert torch.autograd.gradcheck(step, (state, action, *parameters))


def test_many_parameter_values_run_side_by_side() -> None:
    masses = torch.tensor([0.5, 1.0, 2.0], dtype=DOUBLE)
    state, action = torch.tensor([1.0, 0.0], dtype=DOUBLE), torch.tensor([1.0], dtype=DOUBLE)
    together = Pendulum(m=masses)(state, action)
    alone = torch.stack([Pendulum(m=mass)(state, action) for mass in masses])
    torch.testing.assert_close(together, alone)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda pendulum: pickle.loads(pickle.dumps(pendulum))])
def test_copies_and_state_dicts_behave_alike(copied) -> None:
    pendulum = Pendulum(g=9.0, m=0.5, l=2.0, extra_torque=Magnet(strength=0.3))
    other = Pendulum(extra_torque=Magnet())
    other.load_state_dict(pendulum.state_dict())
    state, action = random_batch(pendulum)
    for twin in (copied(pendulum), other):
        assert torch.equal(twin(state, action), pendulum(state, action))


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: Pendulum(equation="other"), '"paper" or "gymnasium", found \'other\''),
        (lambda: Pendulum(m=0.0), "`m` > 0, found 0.0"),
        (lambda: Pendulum(l=-1.0), "`l` > 0"),
        (lambda: Pendulum(dt=0.0), "dt"),
    ],
)
def test_errors_say_what_is_wrong(build, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        build()
