"""What all acquisition functions are: TensorDict modules that write one value a point."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import torch
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from tensordict.utils import NestedKey
from torch import Tensor

from torch_activegp.errors import ConfigurationError


class AcquisitionFunction(TensorDictModuleBase, ABC):
    """Map tensors ``(..., d)`` under :attr:`in_keys` to one value a point ``(..., 1)`` under ``out_keys[0]``.

    A subclass names its default keys and implements :meth:`evaluate`. It sees the posterior through keys alone
    (:mod:`torch_activegp.keys`), so it works with any model that fills them.

    Args:
        in_keys: what to read; default :attr:`default_in_keys`.
        out_keys: where to write; default :attr:`default_out_keys`.

    Raises:
        ConfigurationError: the number of keys does not fit.
    """

    default_in_keys: ClassVar[tuple[NestedKey, ...]]
    default_out_keys: ClassVar[tuple[NestedKey, ...]]

    def __init__(self, in_keys: Sequence[NestedKey] | None = None, out_keys: Sequence[NestedKey] | None = None) -> None:
        super().__init__()
        self.in_keys = list(self.default_in_keys if in_keys is None else in_keys)
        self.out_keys = list(self.default_out_keys if out_keys is None else out_keys)
        if len(self.in_keys) != len(self.default_in_keys) or len(self.out_keys) != 1:
            raise ConfigurationError(
                f"{type(self).__name__}: wanted {len(self.default_in_keys)} in_keys (like {self.default_in_keys}) and "
                f"1 out_key, found {self.in_keys} and {self.out_keys}."
            )

    @abstractmethod
    def evaluate(self, *args: Any, **kwargs: Any) -> Tensor:
        """The value at each point: tensors ``(..., d)`` in the order of :attr:`in_keys` to ``(..., 1)``."""

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Read :attr:`in_keys`, write the value."""
        return tensordict.set(self.out_keys[0], self.evaluate(*(tensordict.get(key) for key in self.in_keys)))


class InUnits(AcquisitionFunction, ABC):
    """An acquisition function whose inputs are first divided by a unit for each state.

    Args:
        unit: scale of each state, ``(d,)``, in its own unit (rad, rad/s, ...); default ones, as in the paper.
        in_keys: see :class:`AcquisitionFunction`.
        out_keys: see :class:`AcquisitionFunction`.

    Raises:
        ConfigurationError: a unit is not positive and finite, or there are several of more than one dimension.
    """

    unit: Tensor

    def __init__(
        self,
        unit: Tensor | Sequence[float] | float = 1.0,
        in_keys: Sequence[NestedKey] | None = None,
        out_keys: Sequence[NestedKey] | None = None,
    ) -> None:
        super().__init__(in_keys, out_keys)
        unit = torch.as_tensor(unit, dtype=torch.float64).detach().clone()
        if unit.dim() > 1 or not bool(((unit > 0) & unit.isfinite()).all()):
            raise ConfigurationError(
                f"{type(self).__name__}: wanted one positive unit, or one for each state, found {unit.tolist()}."
            )
        self.register_buffer("unit", unit)

    def in_units(self, values: Tensor) -> Tensor:
        """Divide ``(..., d)`` by the unit of each state; dtype and device stay."""
        return values / self.unit.to(values)


def norm(values: Tensor) -> Tensor:
    """Euclidean norm over the states: ``(..., d)`` to ``(..., 1)``."""
    return torch.linalg.vector_norm(values, dim=-1, keepdim=True)


def root_mean_square(values: Tensor) -> Tensor:
    """Root mean square over the states: ``(..., d)`` to ``(..., 1)``; equals sigma where all outputs share it."""
    return norm(values) / values.shape[-1] ** 0.5
