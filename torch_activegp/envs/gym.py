"""Gymnasium's MuJoCo environments as real systems: their full state is seen, and can be set."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium
import torch
from gymnasium.envs.mujoco import MujocoEnv
from tensordict import TensorDictBase
from torch import Tensor
from torchrl.data import Unbounded
from torchrl.envs import GymEnv

from torch_activegp import keys
from torch_activegp.envs.start_state import given_state
from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators import StateSpace
from torch_activegp.simulators.mujoco_warnings import warnings_to

_logger = logging.getLogger(__name__)


class MujocoGymEnv(GymEnv):
    """A :class:`~torchrl.envs.GymEnv` with MuJoCo's state (qpos, qvel) under ``"state"``, which ``reset`` can set.

    Every reset and step adds the state in float64, with the root position that Gymnasium's observation hides.
    ``reset(td, set_state=True)`` starts there, with a new time limit. The solver's warm start is zero before each step,
    as in :class:`~torch_activegp.simulators.MujocoSimulator`: the next state depends on state and action alone, and a
    run from any recorded state repeats bit for bit. Gymnasium's own steps differ by the solver's tolerance.

    Args:
        env_name: a Gymnasium environment on a :class:`~gymnasium.envs.mujoco.MujocoEnv`, such as ``"HalfCheetah-v5"``.
        state_space: wraps the angles of ``"state"``; pass that of the simulator in the GP's mean. Default: as MuJoCo
            counts, turn by turn.
        **kwargs: as for :class:`~torchrl.envs.GymEnv`.

    Raises:
        ConfigurationError: there is no such environment, it is not a MuJoCo one or runs several copies, its actuators
            have a state of their own, or ``state_space`` has another dimension.

    Example:
        >>> from tensordict import TensorDict
        >>> env = MujocoGymEnv("InvertedPendulum-v5")
        >>> start = TensorDict({"state": torch.tensor([0.5, 0.1, 0.0, 0.0])})  # qpos, qvel
        >>> env.reset(start, set_state=True)["state"].tolist()
        [0.5, 0.10000000149011612, 0.0, 0.0]
    """

    _supports_set_state = True

    def __init__(self, env_name: str, state_space: StateSpace | None = None, **kwargs: Any) -> None:
        super().__init__(env_name, **kwargs)
        dim = self.observation_spec[keys.STATE].shape[-1]
        if state_space is not None and state_space.dim != dim:
            self.close()
            raise ConfigurationError(
                f"MujocoGymEnv: wanted a state_space of {dim} dimensions (qpos, qvel) for {env_name}, found "
                f"{list(state_space.names)}."
            )
        self.__dict__["state_space"] = state_space  # TorchRL's wrappers cannot look up submodules

    @property
    def dt(self) -> float:
        """The time between two states, s."""
        return float(self._mujoco.dt)

    @property
    def _mujoco(self) -> Any:  # a MujocoEnv, whose reset_model and _get_obs belong to its subclasses
        return self._env.unwrapped

    def _build_env(self, env_name: str, **kwargs: Any) -> gymnasium.Env:
        if kwargs.get("num_envs"):
            raise ConfigurationError("MujocoGymEnv: wanted num_envs=0; for several copies use ParallelEnv.")
        try:
            with warnings_to(_logger.debug):
                env = super()._build_env(env_name, **kwargs)
        except gymnasium.error.UnregisteredEnv as error:
            raise ConfigurationError(f"MujocoGymEnv: Gymnasium has no environment {env_name!r}: {error}") from error
        base = env.unwrapped
        if not isinstance(base, MujocoEnv):
            env.close()
            raise ConfigurationError(
                f"MujocoGymEnv: wanted a Gymnasium environment on MujocoEnv, found {type(base).__name__} for "
                f"{env_name!r}. Use GymEnv for it."
            )
        if base.model.na:
            env.close()
            raise ConfigurationError(
                f"MujocoGymEnv: wanted (qpos, qvel) to be the whole state, found {base.model.na} actuator activations "
                f"in {env_name!r}. Use SimulatorEnv(MujocoSimulator(...)) instead."
            )
        return env

    def _make_specs(self, env: gymnasium.Env, batch_size: torch.Size | None = None) -> None:
        super()._make_specs(env, batch_size)
        base: Any = env.unwrapped
        state = Unbounded((base.model.nq + base.model.nv,), dtype=torch.float64, device=self.device)
        self.observation_spec[keys.STATE] = state
        self.state_spec[keys.STATE] = state.clone()

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        self._mujoco.data.qacc_warmstart[:] = 0.0
        return super()._step(tensordict).set(keys.STATE, self._read_state())

    def _reset(
        self, tensordict: TensorDictBase | None = None, set_state: bool | None = None, **kwargs: Any
    ) -> TensorDictBase:
        if set_state:
            spec = self.observation_spec[keys.STATE]
            with self._starting_at(given_state(tensordict, spec.zero().cpu(), spec.shape[-1])):
                out = super()._reset(tensordict, **kwargs)
        else:
            out = super()._reset(tensordict, **kwargs)
        return out.set(keys.STATE, self._read_state())

    def get_extra_state(self) -> dict[str, Any]:
        """The state of Gymnasium's generator, so that a resumed run draws the same resets."""
        return dict(self._mujoco.np_random.bit_generator.state)

    def set_extra_state(self, state: dict[str, Any]) -> None:
        """Restore the generator."""
        self._mujoco.np_random.bit_generator.state = state

    @contextmanager
    def _starting_at(self, state: Tensor) -> Iterator[None]:
        """Let Gymnasium's own reset, with all its wrappers, end in a given state."""
        base, reset_model = self._mujoco, self._mujoco.reset_model
        qpos, qvel = state.numpy()[: base.model.nq], state.numpy()[base.model.nq :]

        def reset_to_state() -> Any:
            reset_model()
            base.set_state(qpos, qvel)
            return base._get_obs()

        base.reset_model = reset_to_state
        try:
            yield
        finally:
            del base.reset_model

    def _read_state(self) -> Tensor:
        state = torch.from_numpy(self._mujoco.state_vector())
        if self.state_space is not None:
            state = self.state_space.wrap(state.to(self.state_space.low.device))
        return state.to(self.device)
