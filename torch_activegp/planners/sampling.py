"""How the planner draws its candidates and which action it plays."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torchrl.data import TensorSpec

from torch_activegp.errors import ConfigurationError


@dataclass(frozen=True)
class Sampling:
    """Settings of iCEM that seldom change.

    Args:
        noise_beta: exponent of the spectrum ``1 / f ** noise_beta`` of the candidates along time; 0 is white.
        decay: factor >= 1 by which the number of candidates shrinks from one iteration to the next.
        momentum: share in [0, 1) of the old mean and std that an iteration keeps.
        init_std: std of the first iteration, in units of half the range of each action.
        return_best: play the first action of the best candidate of the last iteration, the elites carried into it
            included (so the best of the whole plan, if any are kept); if False, that of the mean.
        action_low: lower bound of the actions, a number or one for each action; None takes it from the spec.
        action_high: upper bound of the actions, in the same form.

    Raises:
        ConfigurationError: a value outside its range.

    Reference:
        Pinneri et al. 2020, arXiv 2008.06389: beta, gamma, alpha and sigma_init of Algorithm 1.

    Example:
        >>> Sampling(noise_beta=0.0).population(num_candidates=50, top_k=10, optim_steps=5)
        (50, 40, 32, 25, 20)
    """

    noise_beta: float = 2.0
    decay: float = 1.25
    momentum: float = 0.1
    init_std: float = 0.5
    return_best: bool = True
    action_low: float | Sequence[float] | None = None
    action_high: float | Sequence[float] | None = None

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, holds, wanted in (
            ("noise_beta", 0.0 <= self.noise_beta < math.inf, "finite and not negative"),
            ("decay", 1.0 <= self.decay < math.inf, "finite and at least 1 (1: no decay)"),
            ("momentum", 0.0 <= self.momentum < 1.0, "in [0, 1)"),
            ("init_std", 0.0 < self.init_std < math.inf, "finite and positive"),
        ):
            if not holds:
                raise ConfigurationError(f"Sampling: `{name}` must be {wanted}, found {getattr(self, name)}.")

    def population(self, num_candidates: int, top_k: int, optim_steps: int) -> tuple[int, ...]:
        """Return how many candidates each iteration draws: decaying, at least twice the elites, never more than asked.

        Args:
            num_candidates: candidates of the first iteration.
            top_k: number of elites.
            optim_steps: number of iterations.
        """
        floor = min(num_candidates, 2 * top_k)
        return tuple(max(int(num_candidates * self.decay**-step), floor) for step in range(optim_steps))

    def bounds(self, spec: TensorSpec) -> tuple[Tensor, Tensor]:
        """Return the bounds within which actions are drawn: the tighter of the spec's and this object's.

        Args:
            spec: action spec of an environment, one vector ``(m,)`` of real numbers.

        Returns:
            Low and high, each ``(m,)``, in the type and on the device of the spec.

        Raises:
            ConfigurationError: the spec is not a vector of real numbers, or the bounds are infinite or empty.
        """
        if spec.dtype is None or not spec.dtype.is_floating_point or len(spec.shape) != 1:
            raise ConfigurationError(
                "ICEMPlanner plans one vector of real actions, a spec of shape (m,); found "
                f"{type(spec).__name__} of shape {tuple(spec.shape)} and type {spec.dtype}. "
                "Flatten or rescale the action with a TorchRL transform."
            )
        low, high = (bound.expand(spec.shape) for bound in (spec.space.low, spec.space.high))
        if self.action_low is not None:
            low = torch.maximum(low, _vector("action_low", self.action_low, low))
        if self.action_high is not None:
            high = torch.minimum(high, _vector("action_high", self.action_high, high))
        largest = torch.finfo(low.dtype).max  # TorchRL's infinity
        if not bool(((low > -largest) & (low < high) & (high < largest)).all()):
            raise ConfigurationError(
                f"ICEMPlanner needs finite bounds with low < high for every action; found low {low.tolist()} and "
                f"high {high.tolist()}. Give the env a Bounded action spec or pass "
                "Sampling(action_low=..., action_high=...)."
            )
        return low.clone(), high.clone()


def _vector(name: str, value: float | Sequence[float], like: Tensor) -> Tensor:
    vector = torch.as_tensor(value, dtype=like.dtype, device=like.device)
    if vector.shape not in (torch.Size(), like.shape):
        raise ConfigurationError(
            f"Sampling: `{name}` must be a number or one number for each of the {like.shape[0]} actions, "
            f"found shape {tuple(vector.shape)}."
        )
    return vector
