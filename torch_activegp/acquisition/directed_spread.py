"""Uncertainty where the simulator is wrong."""

from __future__ import annotations

from torch import Tensor

from torch_activegp import keys
from torch_activegp.acquisition.base import AcquisitionFunction, root_mean_square


class DirectedSpread(AcquisitionFunction):
    """sigma (|mu - p0| + sigma): the model's uncertainty, weighted by how wrong the simulator may be there.

    |mu - p0| + sigma is an upper confidence bound of the simulator's error |p0 - f|. Where the simulator was seen to be
    right the bound is small, and so is the interest in learning it better; where it was seen to be wrong, uncertainty
    counts most; where nothing is known, sigma decides alone. All quantities are relative to the signal's scale, so that
    states of different units count alike. There is no constant to tune.

    In the paper's sum the two terms compete instead: sigma is usually the larger, and decides. What this one gains,
    together with :class:`~torch_activegp.collectors.LargestErrorReductionStart`, is in ``docs/exploration.md``.

    Args:
        in_keys: posterior standard deviation, posterior mean, simulator's prediction, signal scale; each ``(..., d)``.
        out_keys: the value, ``(..., 1)``.

    Example:
        >>> import torch
        >>> half, one, zero = torch.full((2,), 0.5), torch.ones(2), torch.zeros(2)
        >>> (
        ...     DirectedSpread().evaluate(half, zero, zero, one).item(),
        ...     DirectedSpread().evaluate(half, one, zero, one).item(),
        ... )
        (0.25, 0.75)
    """

    default_in_keys = (keys.SCALE, keys.LOC, keys.SIMULATOR_LOC, keys.SIGNAL_SCALE)
    default_out_keys = ("directed_spread",)

    def evaluate(self, scale: Tensor, loc: Tensor, simulator_loc: Tensor, signal_scale: Tensor) -> Tensor:
        """Four tensors ``(..., d)`` to ``(..., 1)``."""
        spread = root_mean_square(scale / signal_scale)
        return spread * (root_mean_square((loc - simulator_loc) / signal_scale) + spread)
