"""The noise floor of a recorded signal, without a model of what was recorded."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torch_activegp.errors import DataError

_ORDERS = (4, 6, 8)
_MAD_TO_STD = 1.4826


def noise_std(signal: Tensor) -> float:
    """Estimate the standard deviation of white measurement noise on a smooth signal.

    Differences of order p remove the signal and leave noise of variance ``binomial(2 p, p) sigma^2``; their median absolute
    deviation is robust to jumps. Of the orders 4, 6 and 8 the smallest estimate counts, because what is left of the
    signal itself can only add. A quantised signal has at least the noise of its step, ``step / sqrt(12)``.

    Noise that a filter in the encoder has made smooth is underestimated.

    Args:
        signal: ``(T,)`` at steady clock, T >= 9.

    Returns:
        Standard deviation in the unit of the signal; 0 for a constant signal.

    Raises:
        DataError: if the signal has fewer than 9 values.

    >>> t = torch.arange(2000) * 0.01
    >>> noise = torch.randn(2000, generator=torch.Generator().manual_seed(0))
    >>> 0.045 < noise_std(torch.sin(t) + 0.05 * noise) < 0.055
    True
    """
    if signal.ndim != 1 or len(signal) <= max(_ORDERS):
        raise DataError(f"a noise floor needs {max(_ORDERS) + 1} values or more, found shape {tuple(signal.shape)}.")
    signal = signal.double()
    floors = []
    for order in _ORDERS:
        differences = torch.diff(signal, n=order)
        spread = _MAD_TO_STD * torch.median(torch.abs(differences)).item()
        floors.append(spread / math.sqrt(math.comb(2 * order, order)))
    return max(min(floors), _quantum(signal) / math.sqrt(12))


def _quantum(signal: Tensor) -> float:
    """Return the step of a quantised signal, 0 if its differences are no multiples of one step."""
    steps = torch.abs(torch.diff(signal))
    steps = steps[steps > 1e-12 * signal.abs().max()]
    if len(steps) == 0:
        return 0.0
    multiples = steps / steps.min()
    on_lattice = bool((torch.abs(multiples - multiples.round()) < 0.02).all())
    return float(steps.min()) if on_lattice and len(torch.unique(multiples.round())) < len(steps) / 2 else 0.0
