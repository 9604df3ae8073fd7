"""The noise floor of a recorded signal, without a model of what was recorded."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torch_activegp.errors import DataError

_ORDERS = (4, 6, 8)
MAD_TO_STD = 1.4826
"""Of normal noise: its standard deviation over the median of its size."""


def noise_std(signal: Tensor, time: Tensor | None = None) -> float:
    """Estimate the standard deviation of white measurement noise on a smooth signal.

    Divided differences of order p, scaled to weights of norm 1, remove any polynomial of lower degree and leave noise
    of variance sigma^2; their median absolute value is robust to jumps. Of the orders 4, 6 and 8 the smallest estimate
    counts, because what is left of the signal itself can only add. A quantised signal has at least the noise of its
    step, ``step / sqrt(12)``.

    Noise that a filter in the encoder has made smooth is underestimated.

    Args:
        signal: ``(T,)``, T >= 9.
        time: clock ``(T,)``, s, increasing; None for a steady clock.

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
    time = torch.arange(len(signal)) if time is None else time / torch.diff(time).median()
    floor = min(float(_differences(time.double(), signal, order).abs().median()) for order in _ORDERS)
    return max(MAD_TO_STD * floor, quantum(signal) / math.sqrt(12))


def _differences(time: Tensor, signal: Tensor, order: int) -> Tensor:
    """Divided differences ``(T - order,)`` of one order, with weights of norm 1."""
    clock = time.unfold(0, order + 1, 1)
    apart = clock[:, :, None] - clock[:, None, :] + torch.eye(order + 1, dtype=clock.dtype)
    weights = 1 / apart.prod(dim=-1)
    return (weights * signal.unfold(0, order + 1, 1)).sum(dim=-1) / weights.norm(dim=-1)


def quantum(signal: Tensor) -> float:
    """Return the step of a quantised signal, 0 if its differences are no multiples of one step."""
    steps = torch.abs(torch.diff(signal))
    steps = steps[steps > 1e-12 * signal.abs().max()]
    if len(steps) == 0:
        return 0.0
    multiples = steps / steps.min()
    on_lattice = bool((torch.abs(multiples - multiples.round()) < 0.02).all())
    return float(steps.min()) if on_lattice and len(torch.unique(multiples.round())) < len(steps) / 2 else 0.0
