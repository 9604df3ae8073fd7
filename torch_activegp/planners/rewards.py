"""Rewards of candidate action sequences in an environment, step by step."""

from __future__ import annotations

from tensordict import NestedKey, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase
from torchrl.modules.planners.common import _mask_post_done_reward, _planning_done_keys

from torch_activegp.errors import ConfigurationError, ShapeError


def can_imagine(env: EnvBase) -> bool:
    """Tell whether an environment offers ``imagine`` itself.

    A ``TransformedEnv`` around such an environment does not: its attribute look-up would reach the base environment
    and skip the transforms.
    """
    return callable(getattr(type(env), "imagine", None))


def imagined_rewards(env: EnvBase, tensordict: TensorDictBase, actions: Tensor) -> Tensor:
    """Ask an environment for the rewards of many candidates at once, without ``env.rollout``.

    Args:
        env: environment with a method ``imagine(tensordict, actions) -> rewards``.
        tensordict: starting states, batch shape ``*B``.
        actions: candidates, ``(*B, C, H, m)``.

    Returns:
        Rewards, ``(*B, C, H)``; infinite or NaN where a candidate is not allowed or not defined.

    Raises:
        ShapeError: ``imagine`` returned another shape.
    """
    rewards: Tensor = env.imagine(tensordict, actions)
    if rewards.shape != actions.shape[:-1]:
        raise ShapeError(
            f"{type(env).__name__}.imagine must return one reward for each candidate and step, "
            f"{tuple(actions.shape[:-1])}; found {tuple(rewards.shape)}."
        )
    return rewards


def rollout_rewards(env: EnvBase, tensordict: TensorDictBase, actions: Tensor, reward_key: NestedKey) -> Tensor:
    """Roll every candidate out in any TorchRL environment with free batch size.

    Every candidate runs over the full horizon; rewards after its first ``done`` (terminated or truncated) are 0.
    A ``done`` that the starting state brings along is ignored.

    Args:
        env: environment whose batch size is not locked.
        tensordict: starting states, batch shape ``*B``.
        actions: candidates, ``(*B, C, H, m)``.
        reward_key: key of the reward in the rollout, for example ``("next", "reward")``.

    Returns:
        Rewards, ``(*B, C, H)``.

    Raises:
        ConfigurationError: the rollout has no such key.
        ShapeError: the reward is not one number for each candidate and step.
    """
    batch = actions.shape[:-2]
    start = tensordict.exclude("next", *env.reward_keys).unsqueeze(-1).expand(batch).clone()
    start.names = None
    start.update(env.full_done_spec.zero(batch))
    steps = iter(actions.unbind(-2))
    path = env.rollout(
        max_steps=actions.shape[-2],
        policy=lambda td: td.set(env.action_key, next(steps)),
        tensordict=start,
        auto_reset=False,
        break_when_any_done=False,
        trust_policy=True,
    )
    rewards = path.get(reward_key, None)
    if rewards is None:
        raise ConfigurationError(f"A rollout of {type(env).__name__} has no {reward_key!r}; found {_leaves(path)}.")
    if rewards.shape not in (actions.shape[:-1], (*actions.shape[:-1], 1)):
        raise ShapeError(
            f"The reward {reward_key!r} must be one number for each candidate and step, "
            f"{(*actions.shape[:-1], 1)}; found {tuple(rewards.shape)}. Sum it in the env or with a transform."
        )
    path.set(reward_key, rewards.reshape(*actions.shape[:-1], 1))
    masked = _mask_post_done_reward(path, reward_key, _planning_done_keys(env), time_dim=len(batch))
    return masked.squeeze(-1)


def _leaves(tensordict: TensorDictBase) -> list[NestedKey]:
    return list(tensordict.keys(include_nested=True, leaves_only=True))
