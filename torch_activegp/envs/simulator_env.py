"""A simulator as the real system: a TorchRL environment whose state can be set."""

from __future__ import annotations

from collections.abc import Callable

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

from torch_activegp import keys
from torch_activegp.envs.start_state import given_state
from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import Simulator


class SimulatorEnv(EnvBase):
    """Any :class:`~torch_activegp.simulators.Simulator` as a TorchRL environment, for any batch shape.

    It plays the true system in experiments. ``reset(td, set_state=True)`` starts at the given state.

    Args:
        simulator: the true dynamics, with ``d`` states and ``m`` actions.
        noise_scale: standard deviation of the noise added to each next state, in its unit; one number or ``(d,)``.
        reward: function of state, action and next state to ``(..., 1)``; default zero.
        seed: of noise and resets, which draw states within the bounds of the state space.

    Raises:
        ConfigurationError: a noise scale is negative or infinite, or there are neither 1 nor ``d``.

    Example:
        >>> from torch_activegp.simulators import Pendulum
        >>> SimulatorEnv(Pendulum()).rollout(5)["next", "state"].shape
        torch.Size([5, 2])
    """

    _supports_set_state = True

    def __init__(
        self,
        simulator: Simulator,
        *,
        noise_scale: Tensor | float = 0.0,
        reward: Callable[[Tensor, Tensor, Tensor], Tensor] | None = None,
        seed: int = 0,
    ) -> None:
        low = simulator.action_space.low
        super().__init__(device=low.device, batch_size=None)
        self.simulator = simulator
        self.noise_scale = torch.as_tensor(noise_scale).to(low)
        fits = self.noise_scale.shape in ((), (simulator.state_dim,))
        if not fits or not bool(((self.noise_scale >= 0) & self.noise_scale.isfinite()).all()):
            raise ConfigurationError(
                f"SimulatorEnv: wanted a finite noise_scale >= 0, one or {simulator.state_dim} of them, found "
                f"{self.noise_scale.tolist()}."
            )
        self.noisy = bool((self.noise_scale > 0).any())
        self.reward = reward
        self.generator = torch.Generator().manual_seed(seed)
        state = Unbounded((simulator.state_dim,), dtype=low.dtype, device=low.device)
        self.observation_spec = Composite({keys.STATE: state}, device=low.device)
        self.state_spec = Composite({keys.STATE: state.clone()}, device=low.device)
        self.action_spec = Bounded(low, simulator.action_space.high, dtype=low.dtype, device=low.device)
        self.reward_spec = Unbounded((1,), dtype=low.dtype, device=low.device)

    @classmethod
    def __new__(cls, *args: object, **kwargs: object) -> EnvBase:
        """Make an environment that takes TensorDicts of every batch shape."""
        return super().__new__(cls, *args, _inplace_update=False, _batch_locked=False, **kwargs)

    @property
    def dt(self) -> float:
        """The time between two states, s."""
        return self.simulator.dt

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        state, action = tensordict.get(keys.STATE), tensordict.get(self.action_key)
        following = self.simulator.step(state, action)
        if self.noisy:
            noise = torch.randn(following.shape, generator=self.generator, dtype=following.dtype).to(following)
            following = self.simulator.state_space.wrap(following + self.noise_scale * noise)
        reward = torch.zeros_like(following[..., :1])
        if self.reward is not None:
            reward = self.reward(state, action, following)
        return TensorDict({keys.STATE: following, keys.REWARD: reward}, tensordict.shape, device=self.device)

    def _reset(
        self, tensordict: TensorDictBase | None = None, set_state: bool | None = None, **kwargs: object
    ) -> TensorDictBase:
        shape = self.batch_size if tensordict is None else tensordict.shape
        if set_state:
            state = given_state(tensordict, self.noise_scale, self.simulator.state_dim)
        else:
            state = self.simulator.state_space.sample(shape, self.generator)
        return TensorDict({keys.STATE: state}, shape, device=self.device)

    def _set_seed(self, seed: int | None) -> None:
        if seed is not None:
            self.generator.manual_seed(seed)

    def get_extra_state(self) -> Tensor:
        """The generator's state, so that a resumed run draws the same noise and resets."""
        return self.generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Restore the generator."""
        self.generator.set_state(state.cpu())
