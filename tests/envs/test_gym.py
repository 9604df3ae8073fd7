"""Gymnasium's MuJoCo environments: full state, set state, and the same physics as our simulator."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.envs.mujoco import MujocoEnv
from tensordict import TensorDict
from torch import Tensor
from torchrl.envs import GymEnv, StepCounter, TransformedEnv
from torchrl.envs.utils import check_env_specs, step_mdp

from torch_activegp.envs import MujocoGymEnv
from torch_activegp.errors import ConfigurationError, ShapeError
from torch_activegp.simulators import MujocoSimulator
from torch_activegp.simulators.mujoco_warnings import warnings_to

NAMES = ["HalfCheetah-v5", "InvertedPendulum-v5"]
SIZES = {"HalfCheetah-v5": (9, 9), "InvertedPendulum-v5": (2, 2)}


@pytest.fixture(params=NAMES)
def env(request: pytest.FixtureRequest) -> MujocoGymEnv:
    return seeded(MujocoGymEnv(request.param))


def seeded(env: MujocoGymEnv) -> MujocoGymEnv:
    env.set_seed(0)
    return env


def simulator_of(env: MujocoGymEnv) -> MujocoSimulator:
    base = env._env.unwrapped
    return MujocoSimulator(base.model, frame_skip=base.frame_skip, nthread=1)


def actions_for(env: MujocoGymEnv, length: int, generator: torch.Generator) -> Tensor:
    space = env.action_spec.space
    return torch.lerp(space.low, space.high, torch.rand(length, len(space.low), generator=generator))


def play(env: MujocoGymEnv, td: TensorDict, actions: Tensor) -> TensorDict:
    steps = []
    for action in actions:
        steps.append(env.step(td.set("action", action)))
        td = step_mdp(steps[-1])
    return torch.stack(steps)


def at(state: Tensor) -> TensorDict:
    return TensorDict({"state": state})


def test_specs(env: MujocoGymEnv) -> None:
    check_env_specs(env, seed=0)
    assert env.observation_spec["state"].dtype == torch.float64
    assert env.observation_spec["state"].shape == (sum(SIZES[env.env_name]),)
    assert env.dt == pytest.approx({"HalfCheetah-v5": 0.05, "InvertedPendulum-v5": 0.04}[env.env_name])


def test_it_is_gymnasiums_env_with_the_state_added(env: MujocoGymEnv, generator: torch.Generator) -> None:
    with warnings_to(lambda message: None):
        plain = GymEnv(env.env_name)
    actions = actions_for(env, 10, generator) / 10
    env.set_seed(3)
    plain.set_seed(3)
    ours, theirs = play(env, env.reset(), actions), play(plain, plain.reset(), actions)
    for key in theirs.keys(True, True):
        torch.testing.assert_close(ours[key], theirs[key], rtol=1e-6, atol=1e-6)
    seen = {"HalfCheetah-v5": slice(1, None), "InvertedPendulum-v5": slice(None)}[env.env_name]
    assert torch.equal(ours["next", "state"][:, seen], ours["next", "observation"])  # without the hidden root position


def test_every_step_is_the_simulators_step(env: MujocoGymEnv, generator: torch.Generator) -> None:
    path = play(env, env.reset(), actions_for(env, 60, generator))
    simulator = simulator_of(env)
    state, action, following = path["state"], path["action"].double(), path["next", "state"]
    error = simulator.state_space.difference(simulator(state, action), following)
    assert error.abs().max() < 1e-10
    free = simulator.state_space.difference(simulator.rollout(state[0], action), following)
    assert free[:20].abs().max() < 1e-6  # the rollout keeps the solver's warm start
    assert (following - state).abs().max() > 0.1


def test_a_run_repeats_bit_for_bit_from_its_state(env: MujocoGymEnv, generator: torch.Generator) -> None:
    actions = actions_for(env, 30, generator)
    first = play(env, env.reset(), actions)
    play(env, env.reset(), actions_for(env, 7, generator))
    again = play(env, env.reset(at(first[0]["state"]), set_state=True), actions)
    other = seeded(MujocoGymEnv(env.env_name))
    elsewhere = play(other, other.reset(at(first[0]["state"]), set_state=True), actions)
    midway = play(env, env.reset(at(first[10]["state"]), set_state=True), actions[10:])
    assert torch.equal(midway["next", "state"], first[10:]["next", "state"])
    for key in first.keys(True, True):
        assert torch.equal(first[key], again[key])
        assert torch.equal(first[key], elsewhere[key])


def test_any_state_can_be_set(env: MujocoGymEnv, generator: torch.Generator) -> None:
    state = 0.1 * torch.rand(sum(SIZES[env.env_name]), generator=generator, dtype=torch.float64)
    td = env.reset(at(state), set_state=True)
    assert torch.equal(td["state"], state)
    assert td["state"].data_ptr() != state.data_ptr()
    assert torch.equal(td["observation"], state[-len(td["observation"]) :])
    assert not td["done"].any()
    following = env.step(td.set("action", env.action_spec.zero()))["next", "state"]
    assert torch.equal(td["state"], state)  # not a view of MuJoCo's memory
    simulator = simulator_of(env)
    expected = simulator(state, torch.zeros(simulator.action_dim, dtype=torch.float64))
    assert simulator.state_space.difference(expected, following).abs().max() < 1e-10


def test_without_set_state_the_state_is_ignored_and_drawn(env: MujocoGymEnv) -> None:
    far = torch.full((sum(SIZES[env.env_name]),), 0.9, dtype=torch.float64)
    drawn = env.reset(at(far), set_state=False)["state"]
    assert (drawn - far).abs().min() > 0.01
    assert not torch.equal(env.reset()["state"], drawn)
    with pytest.warns(FutureWarning, match="without specifying `set_state`"):
        assert torch.equal(env.reset(at(far))["state"], far)


def test_a_new_start_has_a_new_time_limit() -> None:
    env = seeded(MujocoGymEnv("InvertedPendulum-v5", max_episode_steps=4))
    rest, actions = torch.zeros(4, dtype=torch.float64), torch.zeros(4, 1)
    play(env, env.reset(at(rest), set_state=True), actions[:3])
    path = play(env, env.reset(at(rest), set_state=True), actions)
    assert path["next", "truncated"].flatten().tolist() == [False, False, False, True]
    assert path["next", "done"].flatten().tolist() == [False, False, False, True]
    assert not path["next", "terminated"].any()


def test_an_episode_that_ends_starts_anew_by_chance() -> None:
    env = seeded(MujocoGymEnv("InvertedPendulum-v5"))
    fallen = torch.tensor([0.0, 0.19, 0.0, 3.0], dtype=torch.float64)
    push = torch.ones(1)
    path = env.rollout(
        6, lambda td: td.set("action", push), tensordict=at(fallen), set_state=True, break_when_any_done=False
    )
    ends = path["next", "terminated"].flatten().nonzero().flatten().tolist()
    assert ends[0] == 0
    assert path["next", "state"][0, 1] > 0.2  # the state in which it ended, not the new one
    assert torch.equal(path["state"][0], fallen)
    assert path["state"][1].abs().max() <= 0.01  # Gymnasium's own start


def test_transforms_pass_the_state_through(env: MujocoGymEnv) -> None:
    start = env.reset()["state"]
    counted = TransformedEnv(env, StepCounter())
    td = counted.reset(at(start), set_state=True)
    assert torch.equal(td["state"], start)
    assert td["step_count"].item() == 0


def test_seeds_and_a_saved_generator_repeat_the_resets(env: MujocoGymEnv) -> None:
    first = [env.reset()["state"] for _ in range(2)]
    file = io.BytesIO()
    torch.save(env.state_dict(), file)
    third = env.reset()["state"]
    other = MujocoGymEnv(env.env_name)
    other.set_seed(0)
    assert all(torch.equal(other.reset()["state"], state) for state in first)
    other.reset()
    file.seek(0)
    other.load_state_dict(torch.load(file, weights_only=True))
    assert torch.equal(other.reset()["state"], third)


def test_a_state_space_wraps_the_angles(generator: torch.Generator) -> None:
    raw = seeded(MujocoGymEnv("HalfCheetah-v5"))
    space = simulator_of(raw).state_space
    wrapped = seeded(MujocoGymEnv("HalfCheetah-v5", state_space=space))
    check_env_specs(wrapped)
    state = torch.zeros(18, dtype=torch.float64)
    state[1], state[2] = 3.0, 4.0  # high above the floor, more than half a turn
    actions = actions_for(raw, 3, generator)
    turned, plain = (
        play(env, env.reset(at(state), set_state=True), actions)["next", "state"] for env in (wrapped, raw)
    )
    assert (plain[:, 2] > torch.pi).all()
    torch.testing.assert_close(turned, space.wrap(plain), rtol=0, atol=0)
    assert (turned[:, 2] < 0).all()
    with pytest.raises(ConfigurationError, match=r"wanted a state_space of 4 dimensions \(qpos, qvel\) for Inverted"):
        MujocoGymEnv("InvertedPendulum-v5", state_space=space)


def test_a_wrong_start_is_refused(env: MujocoGymEnv) -> None:
    with pytest.raises(ConfigurationError, match="wants a tensordict with 'state', found none"):
        env.reset(set_state=True)
    with pytest.raises(ShapeError, match="reset: wanted a state of shape"):
        env.reset(at(torch.zeros(3)), set_state=True)
    with pytest.raises(ConfigurationError, match="wanted a finite state, found"):
        env.reset(at(torch.full((sum(SIZES[env.env_name]),), torch.nan)), set_state=True)
    assert env.reset()["state"].abs().max() < 1.0  # and the environment still works


def test_only_single_mujoco_environments_are_wrapped() -> None:
    with pytest.raises(
        ConfigurationError, match="wanted a Gymnasium environment on MujocoEnv, found CartPoleEnv for 'C"
    ):
        MujocoGymEnv("CartPole-v1")
    with pytest.raises(ConfigurationError, match="wanted num_envs=0; for several copies use ParallelEnv"):
        MujocoGymEnv("InvertedPendulum-v5", num_envs=2)
    with pytest.raises(ConfigurationError, match="Gymnasium has no environment 'HalfCheeta-v5'.*[Dd]id you mean"):
        MujocoGymEnv("HalfCheeta-v5")


ARM = """<mujoco><worldbody><body><joint name="hip"/><geom size=".1" fromto="0 0 0 0 0 -1" type="capsule"/></body>
</worldbody><actuator><general joint="hip" dyntype="integrator" actlimited="true" actrange="-1 1"/></actuator>
</mujoco>"""


class Arm(MujocoEnv):
    """One hinge whose actuator has a state of its own."""

    def __init__(self, folder: Path) -> None:
        file = folder / "arm.xml"
        file.write_text(ARM, encoding="utf-8")
        box = gymnasium.spaces.Box(-np.inf, np.inf, (2,), np.float64)
        self.metadata = {"render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"]}
        super().__init__(str(file), frame_skip=1, observation_space=box)

    def reset_model(self) -> Any:
        return self.state_vector()


def test_actuators_with_a_state_are_refused(tmp_path: Path) -> None:
    gymnasium.register("Arm-v0", entry_point=lambda **kwargs: Arm(tmp_path))
    try:
        with pytest.raises(ConfigurationError, match=r"\(qpos, qvel\) to be the whole state, found 1 actuator activ"):
            MujocoGymEnv("Arm-v0")
    finally:
        del gymnasium.registry["Arm-v0"]
