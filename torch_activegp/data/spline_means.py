"""Means of what was sampled and changes smoothly in between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

Array = NDArray[np.float64]


def spline_means(time: Array, values: Array, clock: Array, order: int = 3) -> Array:
    """Means of a spline through samples, from each time of a clock to the next; its value where that stands still.

    Args:
        time: of the samples, more than the order of them, s, ``(T,)``.
        values: ``(T,)`` or ``(T, N)``.
        clock: ``(K + 1,)``, s, within the times of the samples.
        order: of the spline.

    Returns:
        ``(K,)`` or ``(K, N)``.
    """
    path = make_interp_spline(time, values, order)
    steps = np.diff(clock).reshape(-1, *(1 for _ in values.shape[1:]))
    means = np.diff(path.antiderivative()(clock), axis=0) / np.where(steps > 0.0, steps, 1.0)
    return np.where(steps > 0.0, means, path(clock[:-1]))
