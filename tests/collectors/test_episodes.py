"""EpisodeCollector runs true episodes, calls back before it plans on, and hands everything to the replay buffer."""

from __future__ import annotations

from pathlib import Path

import gpytorch
import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModule
from torch import Tensor
from torchrl.data import (
    Composite,
    LazyMemmapStorage,
    LazyTensorStorage,
    ReplayBuffer,
    TensorDictReplayBuffer,
    Unbounded,
)
from torchrl.envs import EnvBase, RenameTransform, StepCounter, TransformedEnv
from torchrl.modules import RandomPolicy

from torch_activegp.acquisition import Spread
from torch_activegp.collectors import EpisodeCollector
from torch_activegp.envs import GPEnv, MujocoGymEnv, SimulatorEnv
from torch_activegp.errors import ConfigurationError, SimulationError
from torch_activegp.means import SimulatorMean
from torch_activegp.models import DynamicsGP
from torch_activegp.planners import ICEMPlanner
from torch_activegp.simulators import FunctionSimulator, Pendulum

START = torch.tensor([0.5, -1.0], dtype=torch.float64)


def push(value: float = 1.0) -> TensorDictModule:
    """A constant torque."""
    return TensorDictModule(
        lambda state: torch.full_like(state[..., :1], value), in_keys=["state"], out_keys=["action"]
    )


class Batch(EnvBase):
    """Two systems at once."""

    def __init__(self, batch: tuple[int, ...] = (2,), name: str = "state") -> None:
        super().__init__(batch_size=batch)
        self.observation_spec = Composite({name: Unbounded((*batch, 2))}, shape=batch)
        self.action_spec = Unbounded((*batch, 1))
        self.reward_spec = Unbounded((*batch, 1))

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: object) -> TensorDictBase:
        return self.observation_spec.zero()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        shape = (*self.batch_size, 1)
        done = {"reward": torch.zeros(shape), "done": torch.zeros(shape, dtype=torch.bool)}
        return TensorDict({**self.observation_spec.zero(), **done}, self.batch_size)

    def _set_seed(self, seed: int | None) -> None:
        pass


def test_an_episode_is_what_the_simulator_says() -> None:
    simulator = Pendulum()
    episode = EpisodeCollector(SimulatorEnv(simulator), push(1.5), 6, start=lambda: START).collect()
    assert episode.batch_size == (6,)
    torch.testing.assert_close(episode["state"][0], START)
    assert (episode["action"] == 1.5).all()
    wanted = simulator.rollout(START, torch.full((6, 1), 1.5, dtype=torch.float64))
    torch.testing.assert_close(episode["next", "state"], wanted)
    torch.testing.assert_close(episode["state"][1:], wanted[:-1])


def test_its_keys_are_those_of_a_torchrl_rollout_with_is_init() -> None:
    env = SimulatorEnv(Pendulum())
    episode = EpisodeCollector(env, push(), 3, start=lambda: START).collect()
    keys = set(episode.keys(include_nested=True, leaves_only=True))
    assert keys == {*env.rollout(3).keys(include_nested=True, leaves_only=True), "is_init"}
    assert episode["is_init"].shape == (3, 1)
    assert episode["is_init"].flatten().tolist() == [True, False, False]


def test_without_a_start_the_environment_resets_itself() -> None:
    episodes = [EpisodeCollector(SimulatorEnv(Pendulum(), seed=4), push(), 2).collect() for _ in range(2)]
    torch.testing.assert_close(episodes[0]["state"], episodes[1]["state"])
    torch.testing.assert_close(episodes[0]["state"][0], SimulatorEnv(Pendulum(), seed=4).reset()["state"])


def test_a_start_of_another_dtype_is_converted() -> None:
    episode = EpisodeCollector(SimulatorEnv(Pendulum()), push(), 2, start=lambda: START.float()).collect()
    assert episode["state"].dtype == torch.float64


def test_each_step_is_reported_before_the_next_action_is_chosen() -> None:
    events: list[str] = []

    def policy(state: Tensor) -> Tensor:
        events.append("plan")
        return torch.zeros_like(state[..., :1])

    def on_step(transition: TensorDictBase) -> None:
        assert transition.batch_size == ()
        assert transition["next", "state"].shape == (2,)
        events.append("learn")

    module = TensorDictModule(policy, in_keys=["state"], out_keys=["action"])
    EpisodeCollector(SimulatorEnv(Pendulum()), module, 3).collect(on_step)
    assert events == ["plan", "learn"] * 3


def make_planner(state: Tensor | None = None) -> ICEMPlanner:
    generator = torch.Generator().manual_seed(0)
    if state is not None:
        generator.set_state(state)
    gp = DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel())
    gp.update(torch.zeros(1, 2), torch.zeros(1, 1), torch.zeros(1, 2))
    sizes = {"planning_horizon": 4, "optim_steps": 2, "num_candidates": 8, "top_k": 3, "num_kept": 2}
    return ICEMPlanner(GPEnv(gp, Spread()), generator=generator, **sizes)


def test_the_warm_start_of_a_planner_ends_with_the_episode() -> None:
    planner = make_planner()
    collector = EpisodeCollector(SimulatorEnv(Pendulum()), planner, 3, start=lambda: START)
    collector.collect()
    state = planner.noise.generator.get_state()
    again = collector.collect()
    fresh = EpisodeCollector(SimulatorEnv(Pendulum()), make_planner(state), 3, start=lambda: START).collect()
    assert torch.equal(again["action"], fresh["action"])


def test_an_episode_ends_when_the_environment_is_done() -> None:
    env = TransformedEnv(SimulatorEnv(Pendulum()), StepCounter(max_steps=3))
    episode = EpisodeCollector(env, push(), 10, start=lambda: START).collect()
    assert episode.batch_size == (3,)
    assert episode["next", "done"].flatten().tolist() == [False, False, True]
    torch.testing.assert_close(episode["state"][0], START)


def storage(kind: str, folder: Path) -> LazyTensorStorage | LazyMemmapStorage:
    return LazyTensorStorage(100) if kind == "tensor" else LazyMemmapStorage(100, scratch_dir=folder)


@pytest.mark.parametrize("kind", ["tensor", "memmap"])
def test_the_replay_buffer_holds_every_transition(kind: str, tmp_path: Path) -> None:
    buffer = TensorDictReplayBuffer(storage=storage(kind, tmp_path), batch_size=4)
    collector = EpisodeCollector(SimulatorEnv(Pendulum()), make_planner(), 3, replay_buffer=buffer)
    episodes = torch.cat([collector.collect() for _ in range(2)])
    assert len(buffer) == 6
    stored = buffer[:]
    for key in episodes.keys(include_nested=True, leaves_only=True):
        assert torch.equal(stored[key], episodes[key]), key
    sample = buffer.sample()
    torch.testing.assert_close(sample["next", "state"], Pendulum().step(sample["state"], sample["action"]))


def test_no_gradient_is_kept() -> None:
    env = SimulatorEnv(Pendulum(trainable=True))
    episode = EpisodeCollector(env, push(), 2, start=lambda: START).collect(lambda step: None)
    assert not episode["next", "state"].requires_grad


def test_a_state_that_is_not_finite_is_an_error_and_reaches_no_buffer() -> None:
    pendulum = Pendulum()

    def step(state: Tensor, action: Tensor) -> Tensor:
        following = pendulum.step(state, action)
        return torch.where(following[..., 1:] > 0, torch.nan, following)

    env = SimulatorEnv(FunctionSimulator(step, pendulum.state_space, pendulum.action_space, pendulum.dt))
    buffer, seen = ReplayBuffer(storage=LazyTensorStorage(100)), []
    collector = EpisodeCollector(env, push(2.0), 20, replay_buffer=buffer, start=lambda: torch.tensor([0.0, -0.5]))
    with pytest.raises(
        SimulationError, match=r"finite next state from SimulatorEnv, found \[nan, nan\] in step 1 from"
    ):
        collector.collect(seen.append)
    assert len(seen) == 1
    assert len(buffer) == 0


@pytest.mark.parametrize("length", [0, -1])
def test_a_length_that_is_not_positive_is_an_error(length: int) -> None:
    with pytest.raises(ConfigurationError, match=f"episode_length >= 1, found {length}"):
        EpisodeCollector(SimulatorEnv(Pendulum()), push(), length)


def test_a_start_for_an_environment_that_cannot_be_set_is_an_error() -> None:
    env = Batch(())
    with pytest.raises(ConfigurationError, match="Batch cannot be set to a start state.*start=None"):
        EpisodeCollector(env, push(), 2, start=lambda: START)
    assert EpisodeCollector(env, push(), 2).collect().batch_size == (2,)


def test_a_batch_of_environments_is_an_error() -> None:
    with pytest.raises(ConfigurationError, match=r"batch size \(\), found Batch with batch size \(2,\)"):
        EpisodeCollector(Batch(), push(), 2)


def test_an_environment_without_a_state_is_an_error_and_can_be_renamed() -> None:
    env = Batch((), name="observation")
    with pytest.raises(ConfigurationError, match=r"observation 'state', found Batch with \['observation'\].*Rename"):
        EpisodeCollector(env, push(), 2)
    renamed = TransformedEnv(env, RenameTransform(["observation"], ["state"]))
    assert EpisodeCollector(renamed, push(), 2).collect()["state"].shape == (2, 2)


def test_the_half_cheetah_runs_from_a_state_of_its_own() -> None:
    env = MujocoGymEnv("HalfCheetah-v5")
    size = env.observation_spec["state"].shape[-1]
    state = 0.01 * torch.arange(size, dtype=torch.float64)
    policy = RandomPolicy(env.action_spec)
    episode = EpisodeCollector(env, policy, 3, start=lambda: state).collect()
    assert episode["next", "state"].shape == (3, size)
    torch.testing.assert_close(episode["state"][0].double(), state)
    assert torch.isfinite(episode["next", "state"]).all()
