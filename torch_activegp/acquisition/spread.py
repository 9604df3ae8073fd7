"""How uncertain the model is."""

from __future__ import annotations

from torch import Tensor

from torch_activegp import keys
from torch_activegp.acquisition.base import AcquisitionFunction, InUnits, root_mean_square


class Spread(InUnits):
    """sigma(x, u), the root mean square over the states, each in its unit.

    Where all outputs share one sigma, as in the paper, this is it. Alone it is the sigma-greedy baseline.

    Args:
        unit: scale of each state, ``(d,)``; default ones.
        in_keys: posterior standard deviation, ``(..., d)``.
        out_keys: the spread, ``(..., 1)``.

    Example:
        >>> import torch
        >>> Spread().evaluate(torch.tensor([0.5, 0.5])).item()
        0.5

    Reference: Miller et al. 2024 (arXiv 2403.17233), the second term of the acquisition function.
    """

    default_in_keys = (keys.SCALE,)
    default_out_keys = ("spread",)

    def evaluate(self, scale: Tensor) -> Tensor:
        """``(..., d)`` to ``(..., 1)``."""
        return root_mean_square(self.in_units(scale))


class InformationGain(AcquisitionFunction):
    """sum_j log(1 + sigma_j^2 / noise_j^2): twice the information, in nats, that one observation gives on the dynamics.

    The states' units cancel.

    Args:
        in_keys: standard deviation of posterior and noise, each ``(..., d)``.
        out_keys: the gain, ``(..., 1)``.

    Example:
        >>> import torch
        >>> InformationGain().evaluate(torch.tensor([1.0, 0.0]), torch.ones(2)).exp().item()
        2.0

    Reference: Sukhija et al. 2023, *Optimistic Active Exploration of Dynamical Systems* (OpAx), Eq. 9.
    """

    default_in_keys = (keys.SCALE, keys.NOISE_SCALE)
    default_out_keys = ("information_gain",)

    def evaluate(self, scale: Tensor, noise_scale: Tensor) -> Tensor:
        """``(..., d)``, ``(..., d)`` to ``(..., 1)``."""
        return (scale / noise_scale).square().log1p().sum(-1, keepdim=True)
