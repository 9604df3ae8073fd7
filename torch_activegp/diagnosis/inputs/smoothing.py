"""Slopes and values of a recorded position, freed of noise."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from torch_activegp.data import choose_window
from torch_activegp.data.local_polynomial import local_motion, local_slope

Array = NDArray[np.float64]
_FAITHFUL = 5
"""Degree of the polynomials along which prescribed motion is freed of noise."""


def smooth(time: Array, signal: Array, sigma: float) -> tuple[Array, Array]:
    """Slope and value of a signal, freed of noise by local polynomials."""
    t, y = torch.from_numpy(time.copy()), torch.from_numpy(signal.copy())
    window = choose_window(t, y, sigma) if len(time) >= 15 else 5
    slope = local_slope(t, y, window).numpy()
    # the value at the centre from the slope: shift every neighbour along the slope and average
    half = max(window // 4, 1)
    trend = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(time))])
    return slope, trend + uniform_filter1d(signal - trend, 2 * half + 1, mode="nearest")


def follow(time: Array, signal: Array, sigma: float) -> tuple[Array, Array]:
    """The same where a motion is an input: no part of it may be smoothed away, and noise may rather stay."""
    t, y = torch.from_numpy(time.copy()), torch.from_numpy(signal.copy())
    window = choose_window(t, y, sigma) if len(time) >= 15 else 5
    value, slope = local_motion(t, y, max(window, _FAITHFUL + 2), _FAITHFUL)
    return slope.numpy(), value.numpy()
