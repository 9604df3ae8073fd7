"""Rows of a signal that do not belong to it: glitches of an encoder, a bus or a tracker."""

from __future__ import annotations

import torch
from torch import Tensor

_SIDE = 4
"""Rows on each side that say where those between them should be. With three, 100 of 57 000 rows of a bouncing ball were
found; with four 15, and as many with five."""
_DEGREE = 3
_LONGEST = 2
"""Rows in a row."""
_FAR = 8.0
"""Times what noise makes of the difference; rows at an impact are at most 3.2 times as far as its misfit says."""
_CHUNK = 4096


def outlying(signal: Tensor, time: Tensor, sigma: float) -> Tensor:
    """Find single rows, or two in a row, far from where their neighbours put them, while these agree with each other.

    A cubic through the four rows on each side is asked for the rows between them. What a machine does shows in more
    rows: an impact bends the cubic, and its own misfit counts as noise. Rows with fewer on one side are never found:
    there an impact would bend nothing.

    Args:
        signal: ``(T,)``.
        time: clock ``(T,)``, s, increasing.
        sigma: standard deviation of the noise of a row.

    Returns:
        Whether each row is outlying, ``(T,)``.

    >>> t = torch.arange(200) * 0.01
    >>> signal = torch.sin(5 * t)
    >>> signal[[50, 120, 121]] += 0.3
    >>> outlying(signal, t, 1e-3).nonzero().flatten().tolist()
    [50, 120, 121]
    """
    found = torch.zeros(len(signal), dtype=torch.bool)
    signal, time = signal.double(), time.double()
    for length in range(1, _LONGEST + 1):
        end = len(signal) - _SIDE - length + 1
        for first in range(_SIDE, end, _CHUNK):
            at = torch.arange(first, min(first + _CHUNK, end))[:, None] + torch.arange(length)
            far = _far(signal, time, sigma, at)
            found[at[far]] = True
    return found


def _far(signal: Tensor, time: Tensor, sigma: float, at: Tensor) -> Tensor:
    """Whether all of some neighbouring rows are far off, ``(N,)``, for their numbers ``(N, length)``."""
    count, length = at.shape
    window = at[:, :1] - _SIDE + torch.arange(2 * _SIDE + length)
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
