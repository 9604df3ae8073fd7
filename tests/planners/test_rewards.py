"""Rewards of candidates: the rollout path against plain loops, done, shapes."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict
from torchrl.data import Unbounded
from torchrl.envs import RewardScaling, TransformedEnv

from torch_activegp.errors import ConfigurationError, ShapeError
from torch_activegp.planners.rewards import can_imagine, imagined_rewards, rollout_rewards

KEY = ("next", "reward")


def first_state(state, action):
    return state[..., 0] + 0.0 * action[..., 0]


def push(state, action):
    return state + action


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_rollout_equals_the_environment_stepped_by_hand(batch, point_mass, vector_env, generator):
    env = point_mass.env(vector_env)
    state = torch.randn((*batch, 2), generator=generator, dtype=torch.float64)
    actions = torch.rand((*batch, 4, 6, 1), generator=generator, dtype=torch.float64)
    rewards = rollout_rewards(env, env.start(state), actions, KEY)
    assert rewards.shape == (*batch, 4, 6)
    for candidate in range(4):
        here = state
        for step in range(6):
            action = actions[..., candidate, step, :]
            torch.testing.assert_close(rewards[..., candidate, step], point_mass.score(here, action))
            here = point_mass.move(here, action)


def test_rewards_after_the_first_done_are_zero_and_that_of_the_done_step_counts(vector_env):
    env = vector_env(first_state, push, limit=2.0)
    actions = torch.tensor([1.0, 0.25], dtype=torch.float64).view(2, 1, 1).expand(2, 6, 1)
    rewards = rollout_rewards(env, env.start([0.5]), actions, KEY)
    assert rewards[0].tolist() == [0.5, 1.5, 0.0, 0.0, 0.0, 0.0]  # |x| > 2 after the second step
    assert rewards[1].tolist() == [0.5, 0.75, 1.0, 1.25, 1.5, 1.75]


def test_nan_after_done_does_not_spoil_a_candidate(vector_env):
    env = vector_env(lambda state, action: state[..., 0].where(state[..., 0] <= 2.5, torch.nan), push, limit=2.5)
    actions = torch.ones(1, 5, 1, dtype=torch.float64)
    env._reset = lambda tensordict=None, **kwargs: env.start(torch.full((*tensordict.batch_size, 1), 9.0))
    assert rollout_rewards(env, env.start([1.0]), actions, KEY).tolist() == [[1.0, 2.0, 0.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    "extra",
    [
        {"done": [True], "terminated": [True]},
        {"reward": [5.0]},
        {"is_init": [True], "step_count": [3]},
        {"next": {"state": [4.0]}},
    ],
)
def test_what_a_starting_state_brings_along_changes_nothing(extra, vector_env):
    env = vector_env(first_state, push)
    actions = torch.full((3, 4, 1), 0.5, dtype=torch.float64)
    start = env.start([1.0])
    clean = rollout_rewards(env, start, actions, KEY)
    start.update(TensorDict(extra))
    before = start.clone()
    assert torch.equal(rollout_rewards(env, start, actions, KEY), clean)
    assert (start == before).all()


def test_a_slice_of_a_rollout_is_a_batch_of_starting_states(vector_env):
    env = vector_env(first_state, push)
    path = env.rollout(5)
    rewards = rollout_rewards(env, path, torch.zeros(5, 2, 3, 1, dtype=torch.float64), KEY)
    torch.testing.assert_close(rewards, path["state"].unsqueeze(1).expand(5, 2, 3))


def test_a_transform_hides_the_fast_path(imagining_env, vector_env):
    env = imagining_env(first_state, push)
    assert can_imagine(env)
    assert not can_imagine(vector_env(first_state, push))
    assert not can_imagine(TransformedEnv(env, RewardScaling(0.0, 2.0)))


def test_imagine_of_a_wrong_shape_is_refused(imagining_env):
    env = imagining_env(first_state)
    env.imagine = lambda tensordict, actions: actions
    with pytest.raises(ShapeError, match=r"Imagining.imagine must return .* \(4, 5\); found \(4, 5, 1\)"):
        imagined_rewards(env, env.start([0.0]), torch.zeros(4, 5, 1, dtype=torch.float64))


def test_any_key_of_the_rollout_can_be_the_reward(vector_env):
    env = vector_env(first_state, push)
    actions = torch.full((2, 3, 1), 0.5, dtype=torch.float64)
    rewards = rollout_rewards(env, env.start([1.0]), actions, ("next", "state"))
    assert rewards.tolist() == [[1.5, 2.0, 2.5]] * 2


def test_a_missing_reward_key_is_named(vector_env):
    env = vector_env(first_state)
    with pytest.raises(ConfigurationError, match=r"Vector has no \('next', 'gain'\); found .*\('next', 'reward'\)"):
        rollout_rewards(env, env.start([0.0]), torch.zeros(4, 5, 1, dtype=torch.float64), ("next", "gain"))


def test_a_reward_of_several_numbers_is_refused(vector_env):
    env = vector_env(lambda state, action: torch.cat([state, state], dim=-1))
    env.full_reward_spec = env._nest("reward", Unbounded((2, 1), dtype=torch.float64))
    with pytest.raises(ShapeError, match=r"must be one number for each candidate and step, \(4, 5, 1\)"):
        rollout_rewards(env, env.start([0.0]), torch.zeros(4, 5, 1, dtype=torch.float64), KEY)
