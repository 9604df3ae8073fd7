"""Rows of a signal that do not belong to it: glitches of an encoder, a bus or a tracker."""

from __future__ import annotations

import torch
from torch import Tensor

_SIDE = 3
"""Rows on each side that say where those between them should be."""
_DEGREE = 3
_LONGEST = 2
"""Rows in a row. Three in the middle of an impact are ten times as far from a cubic through their neighbours as these
are, two or one 4.3 times."""
_FAR = 8.0
"""Times what noise makes of the difference."""
_CHUNK = 4096


def outlying(signal: Tensor, time: Tensor, sigma: float) -> Tensor:
    """Find single rows, or two in a row, far from where their neighbours put them, while these agree with each other.

    A cubic through the three rows on each side, at either end through the six that are nearest, is asked for the rows
    between them. What a machine does shows in more rows: an impact bends the cubic, and its own misfit counts as noise.

    Args:
        signal: ``(T,)``.
        time: clock ``(T,)``, s, increasing.
        sigma: standard deviation of the noise of a row.

    Returns:
        Whether each row is outlying, ``(T,)``; none where there are fewer than 12.

    >>> t = torch.arange(200) * 0.01
    >>> signal = torch.sin(5 * t)
    >>> signal[[50, 120, 121]] += 0.3
    >>> outlying(signal, t, 1e-3).nonzero().flatten().tolist()
    [50, 120, 121]
    """
    found = torch.zeros(len(signal), dtype=torch.bool)
    if len(signal) < 4 * _SIDE:
        return found
    signal, time = signal.double(), time.double()
    for length in range(1, _LONGEST + 1):
        for first in range(0, len(signal) - length + 1, _CHUNK):
            at = torch.arange(first, min(first + _CHUNK, len(signal) - length + 1))[:, None] + torch.arange(length)
            far = _far(signal, time, sigma, at)
            found[at[far]] = True
    return found


def _far(signal: Tensor, time: Tensor, sigma: float, at: Tensor) -> Tensor:
    """Whether all of some neighbouring rows are far off, ``(N,)``, for their numbers ``(N, length)``."""
    count, length = at.shape
    start = (at[:, :1] - _SIDE).clamp(0, len(signal) - 2 * _SIDE - length)
    window = start + torch.arange(2 * _SIDE + length)
    around = window[(window < at[:, :1]) | (window > at[:, -1:])].reshape(count, 2 * _SIDE)
    origin, value = time[at[:, :1]], signal[at[:, :1]]
    scale = (time[around] - origin).abs().amax(dim=1, keepdim=True)
    powers, asked = (((time[rows] - origin) / scale)[..., None] ** torch.arange(_DEGREE + 1) for rows in (around, at))
    weights = torch.linalg.pinv(powers)
    cubic = torch.einsum("npw,nw->np", weights, signal[around] - value)
    misfit = torch.einsum("nwp,np->nw", powers, cubic) - signal[around] + value
    noise = torch.clamp(misfit.square().sum(dim=1, keepdim=True) / (2 * _SIDE - _DEGREE - 1), min=sigma**2)
    spread = torch.einsum("nlp,npw->nlw", asked, weights).square().sum(dim=-1)
    error = torch.einsum("nlp,np->nl", asked, cubic) - signal[at] + value
    return (error.square() > _FAR**2 * noise * (1 + spread)).all(dim=1)
