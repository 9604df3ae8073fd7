"""A simulator as the real system: its own steps, noise of the stated size, a state that can be set."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs.utils import check_env_specs

from torch_activegp.envs import SimulatorEnv
from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import Pendulum


def points(*batch: int, generator: torch.Generator) -> TensorDict:
    pendulum = Pendulum()
    state, action = pendulum.state_space.sample(batch, generator), pendulum.action_space.sample(batch, generator)
    return TensorDict({"state": state, "action": action}, batch)


@pytest.mark.parametrize("noise", [0.0, [0.1, 0.2]])
def test_specs(noise: float | list[float]) -> None:
    env = SimulatorEnv(Pendulum(), noise_scale=torch.as_tensor(noise), reward=lambda x, u, y: y[..., :1])
    check_env_specs(env, seed=0)
    assert env.action_spec.space.high.tolist() == [2.0]
    assert env.observation_spec["state"].dtype == torch.float64
    assert env.dt == 0.05


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_it_steps_as_the_simulator(batch: tuple[int, ...], generator: torch.Generator) -> None:
    env = SimulatorEnv(Pendulum(m=0.5), reward=lambda x, u, y: (x + 10 * y).sum(-1, keepdim=True) + u)
    td = points(*batch, generator=generator)
    out = env.step(td.clone())["next"]
    expected = Pendulum(m=0.5)(td["state"], td["action"])
    assert torch.equal(out["state"], expected)
    torch.testing.assert_close(out["reward"], (td["state"] + 10 * expected).sum(-1, keepdim=True) + td["action"])
    assert not out["done"].any()
    assert torch.equal(SimulatorEnv(Pendulum()).step(td)["next", "reward"], torch.zeros(*batch, 1, dtype=torch.float64))


def test_a_rollout_is_the_simulators_rollout(generator: torch.Generator) -> None:
    env = SimulatorEnv(Pendulum())
    start = points(3, generator=generator).select("state")
    path = env.rollout(12, tensordict=start.clone(), auto_reset=False)
    torch.testing.assert_close(path["next", "state"], Pendulum().rollout(start["state"], path["action"]))


def test_the_noise_has_the_stated_size_and_stays_on_the_circle(generator: torch.Generator) -> None:
    env = SimulatorEnv(Pendulum(), noise_scale=torch.tensor([0.3, 0.0]))
    td = points(1, generator=generator).expand(20000).clone()
    td["state"] = torch.tensor([3.1, 0.0], dtype=torch.float64).expand(20000, 2)
    clean = Pendulum()(td["state"], td["action"])
    noisy = env.step(td)["next", "state"]
    error = Pendulum().state_space.difference(noisy, clean)
    assert error[:, 0].std().item() == pytest.approx(0.3, rel=0.03)
    assert abs(error[:, 0].mean().item()) < 0.01
    assert torch.equal(noisy[:, 1], clean[:, 1])
    assert noisy[:, 0].min() < -2.5
    assert noisy[:, 0].abs().max() <= torch.pi


def test_seeds_decide_noise_and_resets(generator: torch.Generator) -> None:
    def path(env: SimulatorEnv) -> Tensor:
        td = env.reset(TensorDict({}, [5]))
        td["action"] = torch.zeros(5, 1, dtype=torch.float64)
        return env.step(td)["next", "state"]

    before = torch.get_rng_state()
    first, same, other = (path(SimulatorEnv(Pendulum(), noise_scale=0.1, seed=seed)) for seed in (1, 1, 2))
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.equal(first, same)
    assert not torch.equal(first, other)
    env = SimulatorEnv(Pendulum(), noise_scale=0.1)
    env.set_seed(1)
    assert torch.equal(path(env), first)
    fresh = SimulatorEnv(Pendulum(), noise_scale=0.1)
    fresh.load_state_dict(env.state_dict())
    assert torch.equal(path(fresh), path(env))


def test_reset_draws_all_states_within_the_bounds() -> None:
    space = Pendulum().state_space
    states = SimulatorEnv(Pendulum()).reset(TensorDict({}, [500]))["state"]
    assert ((states >= space.low) & (states <= space.high)).all()
    assert (states.abs().amax(0) > 0.97 * space.high).all()


@pytest.mark.parametrize("batch", [(), (3,)])
def test_reset_starts_where_it_is_told(batch: tuple[int, ...]) -> None:
    env = SimulatorEnv(Pendulum())
    start = TensorDict({"state": torch.full((*batch, 2), 0.25)}, batch)
    td = env.reset(start.clone(), set_state=True)
    assert td["state"].dtype == torch.float64
    assert td["state"].eq(0.25).all()
    assert not td["done"].any()
    assert not env.reset(start.clone(), set_state=False)["state"].eq(0.25).any()
    with pytest.raises(ConfigurationError, match="wants a tensordict with 'state', found none"):
        env.reset(set_state=True)


def test_gradients_reach_the_state_and_the_parameters(generator: torch.Generator) -> None:
    pendulum = Pendulum(trainable=True)
    td = points(3, generator=generator)
    td["state"].requires_grad_()
    SimulatorEnv(pendulum).step(td)["next", "state"].sum().backward()
    assert td["state"].grad.norm() > 0
    assert pendulum.m.grad.norm() > 0


@pytest.mark.parametrize("noise", [-0.1, [0.1, -0.1], float("nan"), float("inf"), [0.1, 0.1, 0.1], [[0.1, 0.1]]])
def test_a_wrong_noise_scale_is_refused(noise: float | list[float]) -> None:
    with pytest.raises(ConfigurationError, match="wanted a finite noise_scale >= 0, one or 2 of them, found"):
        SimulatorEnv(Pendulum(), noise_scale=torch.as_tensor(noise))
