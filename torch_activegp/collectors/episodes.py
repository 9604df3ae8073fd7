"""Episodes of the real system, step by step, into a replay buffer."""

from __future__ import annotations

from collections.abc import Callable

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import ReplayBuffer
from torchrl.envs import EnvBase
from torchrl.envs.utils import step_mdp

from torch_activegp import keys
from torch_activegp.errors import ConfigurationError, SimulationError


class EpisodeCollector:
    """Run a policy in the real system from a chosen state, one episode at a time.

    TorchRL's collectors gather frames and hand them over in batches; active learning must learn from each transition
    before it plans the next one, so this collector calls back at every step.

    Args:
        env: the real system; one TorchRL environment (batch size ``()``) that shows its ``"state"``.
        policy: a TensorDict module from ``"state"`` to the environment's action, e.g. a planner.
        episode_length: steps per episode; an episode ends earlier when the environment is done.
        replay_buffer: gets each finished episode's transitions.
        start: returns the start state ``(d,)``; default: the environment's own reset.

    Raises:
        ConfigurationError: ``episode_length`` is not positive, the environment is a batch or shows no state, or a
            start is given and the environment's state cannot be set.

    Example:
        >>> from torchrl.modules import RandomPolicy
        >>> from torch_activegp.envs import SimulatorEnv
        >>> from torch_activegp.simulators import Pendulum
        >>> env = SimulatorEnv(Pendulum())
        >>> EpisodeCollector(env, RandomPolicy(env.action_spec), 5, start=lambda: torch.zeros(2)).collect().shape
        torch.Size([5])
    """

    def __init__(
        self,
        env: EnvBase,
        policy: Callable[[TensorDictBase], TensorDictBase],
        episode_length: int,
        *,
        replay_buffer: ReplayBuffer | None = None,
        start: Callable[[], Tensor] | None = None,
    ) -> None:
        if episode_length < 1:
            raise ConfigurationError(f"Wanted episode_length >= 1, found {episode_length}.")
        _check_env(env, settable=start is not None)
        self.env = env
        self.policy = policy
        self.episode_length = episode_length
        self.replay_buffer = replay_buffer
        self.start = start

    def collect(self, on_step: Callable[[TensorDictBase], None] | None = None) -> TensorDictBase:
        """Run one episode.

        Args:
            on_step: called with each transition (``"state"``, ``"action"``, ``("next", "state")``, ...), batch ``()``,
                before the next action is chosen.

        Returns:
            The episode, batch ``(T,)`` with ``T <= episode_length``; ``"is_init"`` marks its first step.

        Raises:
            SimulationError: the system returned a state that is not finite; nothing reaches the replay buffer.
        """
        current = self._reset()
        transitions: list[TensorDictBase] = []
        while len(transitions) < self.episode_length:
            transition = self._step(current, len(transitions))
            transitions.append(transition)
            if on_step is not None:
                on_step(transition)
            if bool(transition.get(("next", "done")).any()):
                break
            current = step_mdp(transition)
        episode = torch.stack(transitions)
        if self.replay_buffer is not None:
            self.replay_buffer.extend(episode)
        return episode

    @torch.no_grad()
    def _reset(self) -> TensorDictBase:
        if self.start is None:
            return self.env.reset()
        state = self.start().to(self.env.observation_spec[keys.STATE].dtype)
        return self.env.reset(TensorDict({keys.STATE: state}, [], device=self.env.device), set_state=True)

    @torch.no_grad()
    def _step(self, current: TensorDictBase, index: int) -> TensorDictBase:
        current.set("is_init", torch.full((1,), index == 0, device=self.env.device))
        transition = self.env.step(self.policy(current))
        following = transition.get(("next", keys.STATE))
        if not bool(torch.isfinite(following).all()):
            raise SimulationError(
                f"Wanted a finite next state from {type(self.env).__name__}, found {following.tolist()} in step "
                f"{index} from state {transition.get(keys.STATE).tolist()} under action "
                f"{transition.get(self.env.action_key).tolist()}. Mend the system there, or keep it away (SafeSet)."
            )
        return transition


def _check_env(env: EnvBase, *, settable: bool) -> None:
    name = type(env).__name__
    if env.batch_size:
        raise ConfigurationError(
            f"Wanted one environment, batch size (), found {name} with batch size {tuple(env.batch_size)}. "
            "Learning from every step needs one system at a time."
        )
    if keys.STATE not in env.observation_spec.keys():
        raise ConfigurationError(
            f"Wanted an environment with the observation {keys.STATE!r}, found {name} with "
            f"{list(env.observation_spec.keys())}. Rename it with TorchRL's RenameTransform."
        )
    if settable and not env._supports_set_state:
        raise ConfigurationError(
            f"{name} cannot be set to a start state. Use an environment with `_supports_set_state` (SimulatorEnv, "
            "MujocoGymEnv), or pass start=None to start at its own reset."
        )
