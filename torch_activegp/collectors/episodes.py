"""Episodes of the real system, step by step, into a replay buffer."""

from __future__ import annotations

from collections.abc import Callable

import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
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
        env: the real system; a TorchRL environment whose ``"state"`` can be set.
        policy: a TensorDict module from ``"state"`` to the environment's action, e.g. a planner.
        episode_length: steps per episode; an episode ends earlier when the environment is done.
        replay_buffer: gets each finished episode's transitions.
        start: returns the start state ``(d,)``; default: the environment's own reset.

    Raises:
        ConfigurationError: ``episode_length`` is not positive, or a start is given and the environment's state cannot
            be set.
    """

    def __init__(
        self,
        env: EnvBase,
        policy: TensorDictModuleBase | Callable[[TensorDictBase], TensorDictBase],
        episode_length: int,
        *,
        replay_buffer: ReplayBuffer | None = None,
        start: Callable[[], Tensor] | None = None,
    ) -> None:
        if episode_length < 1:
            raise ConfigurationError(f"Wanted episode_length >= 1, found {episode_length}.")
        if start is not None and not env._supports_set_state:
            raise ConfigurationError(
                f"{type(env).__name__} cannot be set to a start state. Use an environment with `_supports_set_state` "
                "(SimulatorEnv, MujocoGymEnv), or pass start=None to start at its own reset."
            )
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
            The episode, batch ``(T,)`` with ``T <= episode_length``.

        Raises:
            SimulationError: the system returned a state that is not finite.
        """
        current = self._reset()
        transitions = []
        for step in range(self.episode_length):
            current.set("is_init", torch.full((1,), step == 0, device=self.env.device))
            transition = self.env.step(self.policy(current))
            self._check(transition, step)
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

    def _reset(self) -> TensorDictBase:
        if self.start is None:
            return self.env.reset()
        state = self.start()
        return self.env.reset(TensorDict({keys.STATE: state}, [], device=self.env.device), set_state=True)

    def _check(self, transition: TensorDictBase, step: int) -> None:
        following = transition.get(("next", keys.STATE))
        if not bool(torch.isfinite(following).all()):
            raise SimulationError(
                f"Wanted a finite next state from {type(self.env).__name__}, found {following.tolist()} in step {step} "
                f"from state {transition.get(keys.STATE).tolist()} under action "
                f"{transition.get(self.env.action_key).tolist()}. Mend the system there, or keep it away (SafeSet)."
            )
