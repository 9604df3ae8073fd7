"""Small environments with known optima, with free batch size."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.data import Bounded, Composite, Unbounded
from torchrl.envs import EnvBase

F64 = torch.float64


class Vector(EnvBase):
    """Reward ``score(state, action)`` and next state ``move(state, action)`` of a vector, in float64."""

    batch_locked = False

    def __init__(
        self,
        score: Callable[[Tensor, Tensor], Tensor],
        move: Callable[[Tensor, Tensor], Tensor] = lambda state, action: state,
        *,
        state_dim: int = 1,
        action_dim: int = 1,
        bound: float = 1.0,
        group: tuple[str, ...] = (),
        limit: float = math.inf,
    ) -> None:
        super().__init__(device=None, batch_size=())
        self.score, self.move, self.limit = score, move, limit
        self.keys_ = {name: (*group, name) for name in ("state", "action", "reward", "done")}
        self.observation_spec = Composite()
        self.observation_spec[self.keys_["state"]] = Unbounded((state_dim,), dtype=F64)
        self.state_spec = self.observation_spec.clone()
        action = Bounded(-bound, bound, (action_dim,), dtype=F64) if bound else Unbounded((action_dim,), dtype=F64)
        self.full_action_spec = self._nest("action", action)
        self.full_reward_spec = self._nest("reward", Unbounded((1,), dtype=F64))
        self.seen: list[Tensor] = []
        self.states: list[Tensor] = []

    def _nest(self, name: str, spec: object) -> Composite:
        nested = Composite()
        nested[self.keys_[name]] = spec
        return nested

    def start(self, state: Tensor | list[float]) -> TensorDict:
        state = torch.as_tensor(state, dtype=F64)
        tensordict = TensorDict(batch_size=state.shape[:-1])
        return tensordict.set(self.keys_["state"], state)

    def _reset(self, tensordict: TensorDictBase | None = None, **kwargs: object) -> TensorDict:
        batch = () if tensordict is None else tensordict.batch_size
        return self.start(self.observation_spec[self.keys_["state"]].zero(batch))

    def _step(self, tensordict: TensorDictBase) -> TensorDict:
        state, action = tensordict[self.keys_["state"]], tensordict[self.keys_["action"]]
        self.seen.append(action)
        self.states.append(state)
        following = self.move(state, action)
        out = self.start(following)
        out.set(self.keys_["reward"], self.score(state, action).unsqueeze(-1))
        done = following[..., :1].abs() > self.limit
        return out.update({"done": done, "terminated": done})

    def _set_seed(self, seed: int | None) -> None:
        pass


class Imagining(Vector):
    """The same, with the fast path."""

    def imagine(self, tensordict: TensorDictBase, actions: Tensor) -> Tensor:
        self.seen.append(actions)
        state = tensordict[self.keys_["state"]].unsqueeze(-2).expand(*actions.shape[:-2], -1)
        rewards = []
        for action in actions.unbind(-2):
            rewards.append(self.score(state, action))
            state = self.move(state, action)
        return torch.stack(rewards, dim=-1)


class PointMass:
    """A mass pushed on a line, quadratic cost: position and speed, dt 0.2 s, optimum by the Riccati recursion."""

    A = torch.tensor([[1.0, 0.2], [0.0, 1.0]], dtype=F64)
    B = torch.tensor([[0.02], [0.2]], dtype=F64)
    Q = torch.diag(torch.tensor([1.0, 0.1], dtype=F64))
    R = torch.tensor([[0.05]], dtype=F64)

    @classmethod
    def move(cls, state: Tensor, action: Tensor) -> Tensor:
        return state @ cls.A.T + action @ cls.B.T

    @classmethod
    def score(cls, state: Tensor, action: Tensor) -> Tensor:
        following = cls.move(state, action)
        return -((following @ cls.Q) * following).sum(-1) - ((action @ cls.R) * action).sum(-1)

    @classmethod
    def optimum(cls, state: Tensor, horizon: int) -> Tensor:
        """First action of the best sequence without bounds, ``(..., 1)``."""
        value = torch.zeros(2, 2, dtype=F64)
        for _ in range(horizon):
            stage = cls.Q + value
            gain = torch.linalg.solve(cls.R + cls.B.T @ stage @ cls.B, cls.B.T @ stage @ cls.A)
            value = cls.A.T @ stage @ (cls.A - cls.B @ gain)
        return -state @ gain.T

    @classmethod
    def env(cls, kind: type[Vector] = Imagining, **kwargs: object) -> Vector:
        return kind(cls.score, cls.move, state_dim=2, **kwargs)


@pytest.fixture
def vector_env() -> type[Vector]:
    return Vector


@pytest.fixture
def imagining_env() -> type[Imagining]:
    return Imagining


@pytest.fixture
def point_mass() -> type[PointMass]:
    return PointMass
