"""What the loop asks the real system: bounds of actions, time step."""

from __future__ import annotations

import gpytorch
import pytest
import torch
from torchrl.data import Bounded, Unbounded
from torchrl.envs import StepCounter, TransformedEnv

from torch_activegp.envs import SimulatorEnv
from torch_activegp.errors import ConfigurationError
from torch_activegp.loops.system import action_space_of, time_step_of
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP
from torch_activegp.simulators import Pendulum


class Plain(SimulatorEnv):
    """A system that hides its simulator, as a machine does."""

    def __init__(self, dt: float | None = None) -> None:
        super().__init__(Pendulum())
        self._modules.pop("simulator")
        self.time_step = dt

    @property
    def dt(self) -> float | None:
        return self.time_step


def make_gp(dt: float | None) -> DynamicsGP:
    space = Pendulum().state_space
    mean = gpytorch.means.ZeroMean(batch_shape=torch.Size([2])) if dt is None else SimulatorMean(Pendulum(dt=dt))
    return DynamicsGP(EpisodicMean(mean), gpytorch.kernels.RBFKernel(), state_space=space)


def test_a_simulator_tells_its_action_space() -> None:
    env = SimulatorEnv(Pendulum())
    assert action_space_of(env) is env.simulator.action_space
    assert action_space_of(TransformedEnv(env, StepCounter())) is env.simulator.action_space


def test_any_other_environment_tells_its_bounds() -> None:
    env = Plain()
    env.action_spec = Bounded(torch.tensor([-1.0, -3.0]), torch.tensor([2.0, 4.0]))
    space = action_space_of(env)
    assert space.names == ("action 0", "action 1")
    assert space.low.tolist() == [-1.0, -3.0]
    assert space.high.tolist() == [2.0, 4.0]
    assert space.low.dtype == torch.float64


def test_actions_without_bounds_are_an_error() -> None:
    env = Plain()
    env.action_spec = Unbounded((1,))
    with pytest.raises(ConfigurationError, match="bounded actions of Plain, found Unbounded"):
        action_space_of(env)


@pytest.mark.parametrize(
    "wrap", [lambda env: env, lambda env: TransformedEnv(env, StepCounter())], ids=["env", "wrapped"]
)
def test_the_environment_knows_the_time_step(wrap: type) -> None:
    assert time_step_of(wrap(SimulatorEnv(Pendulum(dt=0.02))), make_gp(0.05)) == 0.02


def test_else_the_simulator_in_the_mean_knows_it() -> None:
    assert time_step_of(Plain(), make_gp(0.03)) == 0.03
    bare = DynamicsGP(SimulatorMean(Pendulum(dt=0.04)), gpytorch.kernels.RBFKernel())
    assert time_step_of(Plain(), bare) == 0.04


def test_an_unknown_time_step_is_an_error() -> None:
    assert time_step_of(Plain(0.1), make_gp(None)) == 0.1
    with pytest.raises(ConfigurationError, match="neither Plain nor the GP's mean has `dt`"):
        time_step_of(Plain(), make_gp(None))
