"""Side information: where the system may go."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from tensordict.utils import NestedKey
from torch import Tensor

from torch_activegp import keys
from torch_activegp.acquisition.base import AcquisitionFunction
from torch_activegp.errors import ConfigurationError, ShapeError


class SafeSet(AcquisitionFunction):
    """0 inside a set, minus infinity outside; the planner never keeps a candidate that leaves it.

    By default the set holds the predicted next state, the first one that an action can change. A value that is not
    finite is outside.

    Args:
        contains: a function from states ``(..., d)`` to booleans ``(...)`` or ``(..., 1)``, e.g.
            ``lambda x: x[..., 0].abs() < 1``; or :class:`Box`.
        penalty: what a step outside costs. The paper's infinity forbids it, and the planner raises
            :class:`~torch_activegp.errors.PlanningError` where no candidate stays inside, which an imperfect model can
            bring about; a large finite penalty makes it leave the set as seldom as it can.
        in_keys: what is tested, ``(..., d)``.
        out_keys: 0 or ``-penalty``, ``(..., 1)``.

    Raises:
        ConfigurationError: the penalty is not positive.

    Example:
        >>> safe = SafeSet(Box([-1.0], [1.0]))
        >>> safe.evaluate(torch.tensor([[0.5], [2.0]])).flatten().tolist()
        [0.0, -inf]

    Reference: Miller et al. 2024 (arXiv 2403.17233), side information s_tau.
    """

    default_in_keys = (keys.LOC,)
    default_out_keys = ("safe",)

    def __init__(
        self,
        contains: Callable[[Tensor], Tensor],
        penalty: float = torch.inf,
        in_keys: Sequence[NestedKey] | None = None,
        out_keys: Sequence[NestedKey] | None = None,
    ) -> None:
        super().__init__(in_keys, out_keys)
        if not penalty > 0:
            raise ConfigurationError(f"SafeSet: wanted a penalty > 0, found {penalty}.")
        self.contains = contains
        self.penalty = float(penalty)

    def evaluate(self, value: Tensor) -> Tensor:
        """``(..., d)`` to ``(..., 1)``.

        Raises:
            ShapeError: ``contains`` returned another shape than ``(...)`` or ``(..., 1)``.
        """
        inside = torch.as_tensor(self.contains(value))
        if inside.shape == value.shape[:-1]:
            inside = inside.unsqueeze(-1)
        if inside.shape != (*value.shape[:-1], 1):
            raise ShapeError(
                f"SafeSet: for states {tuple(value.shape)} `contains` should return {tuple(value.shape[:-1])}, found "
                f"{tuple(inside.shape)}. Combine the conditions on several states, e.g. with .all(-1)."
            )
        inside = inside.bool() & torch.isfinite(value).all(-1, keepdim=True)
        return torch.zeros_like(inside, dtype=value.dtype).masked_fill(~inside, -self.penalty)


class Box:
    """Whether a state lies between two corners, both included.

    Args:
        low: lower corner, ``(d,)``.
        high: upper corner, ``(d,)``.

    Raises:
        ConfigurationError: the corners differ in shape, or ``low > high``.
    """

    def __init__(self, low: Tensor | Sequence[float], high: Tensor | Sequence[float]) -> None:
        self.low = torch.as_tensor(low, dtype=torch.float64)
        self.high = torch.as_tensor(high, dtype=torch.float64)
        if self.low.shape != self.high.shape or not bool((self.low <= self.high).all()):
            raise ConfigurationError(
                f"Box: wanted low <= high for each state, found low={self.low.tolist()}, high={self.high.tolist()}."
            )

    def __call__(self, state: Tensor) -> Tensor:
        """``(..., d)`` to booleans ``(...)``, compared in the dtype of the state."""
        return ((state >= self.low.to(state)) & (state <= self.high.to(state))).all(-1)
