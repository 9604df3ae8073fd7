"""The baseline that knows nothing."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from tensordict.utils import NestedKey
from torch import Tensor

from torch_activegp import keys
from torch_activegp.acquisition.base import AcquisitionFunction


class RandomScore(AcquisitionFunction):
    """A uniform random number in [0, 1), whatever the point: the planner's actions become its own coloured noise.

    Args:
        generator: source of chance.
        in_keys: read for shape, dtype and device alone.
        out_keys: the number, ``(..., 1)``.
    """

    default_in_keys = (keys.LOC,)
    default_out_keys = ("random",)

    def __init__(
        self,
        generator: torch.Generator,
        in_keys: Sequence[NestedKey] | None = None,
        out_keys: Sequence[NestedKey] | None = None,
    ) -> None:
        super().__init__(in_keys, out_keys)
        self.generator = generator

    def evaluate(self, value: Tensor) -> Tensor:
        """``(..., d)`` to ``(..., 1)``."""
        shape = (*value.shape[:-1], 1)
        return torch.rand(shape, generator=self.generator, dtype=value.dtype, device=self.generator.device).to(value)

    def get_extra_state(self) -> Tensor:
        """The generator's state, so that a resumed run draws the same numbers."""
        return self.generator.get_state()

    def set_extra_state(self, state: Tensor) -> None:
        """Restore the generator."""
        self.generator.set_state(state.cpu())
