"""Rows that a recorder has dropped: where they were, and what was commanded meanwhile."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

Array = NDArray[np.float64]
_MISSING = 1.5
_BETTER = 0.9
"""Interpolation must be so much closer than the value before."""
_LEAST = 20


def filled(time: Array) -> tuple[NDArray[np.bool_], Array]:
    """A clock with a row where one was dropped: which rows were recorded, and when all of them are, ``(K + 1,)``, s."""
    steps = np.diff(time)
    count = np.maximum(np.rint(steps / np.median(steps)), 1).astype(int)
    count[steps <= _MISSING * np.median(steps)] = 1
    clock, recorded = [time[:1]], [True]
    for start, step, n in zip(time[:-1], steps, count, strict=True):
        clock.append(start + step * np.arange(1, n + 1) / n)
        recorded += [False] * (n - 1) + [True]
    return np.array(recorded), np.concatenate(clock)


def bridged(inputs: Array, recorded: NDArray[np.bool_]) -> Array:
    """Inputs in all rows ``(K + 1, n)`` from those in the recorded ones ``(R, n)``.

    In a dropped row an input is the one before, or on a line or a cubic spline through its neighbours: whichever tells
    recorded rows from theirs best.
    """
    before = inputs[np.cumsum(recorded) - 1]
    rows, gaps = np.flatnonzero(recorded), np.flatnonzero(~recorded)
    if not len(gaps):
        return before
    out = before.copy()
    for column, signal in enumerate(inputs.T):
        errors = _errors(before[:, column], recorded)
        if len(errors[0]) < _LEAST:
            continue
        hold, line, curve = (float((error**2).sum()) for error in errors)
        if min(line, curve) < _BETTER**2 * hold:
            between = CubicSpline(rows, signal)(gaps) if curve < line else np.interp(gaps, rows, signal)
            out[gaps, column] = np.clip(between, signal.min(), signal.max())
    return out


def _errors(signal: Array, recorded: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Errors of recorded rows between two recorded ones on either side: from the value before, a line and a cubic."""
    whole = np.lib.stride_tricks.sliding_window_view(recorded, 5).all(axis=1)
    far, near, here, after, beyond = np.lib.stride_tricks.sliding_window_view(signal, 5)[whole].T
    line = 0.5 * (near + after)
    return here - near, here - line, here - line - (2.0 * line - far - beyond) / 16.0
