"""How far the model has moved away from a reference."""

from __future__ import annotations

from torch import Tensor

from torch_activegp import keys
from torch_activegp.acquisition.base import InUnits, norm


class Discrepancy(InUnits):
    """|mu(x, u) - m(x, u)|, the Euclidean norm over the states, each in its unit.

    The reference m is the episode's prior m_tau, as in the paper. For the distance from the first simulator p0 pass
    ``in_keys=[LOC, SIMULATOR_LOC]``. With our GP neither calls the simulator a second time.

    Args:
        unit: scale of each state, ``(d,)``; default ones.
        in_keys: posterior mean and reference, each ``(..., d)``.
        out_keys: the discrepancy, ``(..., 1)``.

    Example:
        >>> import torch
        >>> Discrepancy().evaluate(torch.tensor([3.0, 4.0]), torch.zeros(2)).item()
        5.0

    Reference: Miller et al. 2024 (arXiv 2403.17233), the first term of the acquisition function.
    """

    default_in_keys = (keys.LOC, keys.PRIOR_LOC)
    default_out_keys = ("discrepancy",)

    def evaluate(self, loc: Tensor, reference: Tensor) -> Tensor:
        """``(..., d)``, ``(..., d)`` to ``(..., 1)``."""
        return norm(self.in_units(loc - reference))
