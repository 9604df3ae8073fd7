"""Value and slope of a sampled signal from polynomials fitted to a sliding window."""

from __future__ import annotations

import torch
from scipy.signal import savgol_filter
from torch import Tensor

from torch_activegp.errors import ConfigurationError

DEGREE = 3
_REGULAR = 1e-3
_CHUNK = 4096


def local_slope(time: Tensor, values: Tensor, window: int) -> Tensor:
    """Differentiate a signal: at each row, the slope of the cubic that fits the window around it best.

    At the ends, the first and the last full window serve all rows that they cover. On a regular clock (steps equal to
    0.1 %) this is the filter of Savitzky and Golay; otherwise each window is a least-squares problem of its own with
    the true times.

    Args:
        time: clock ``(T,)``, s, increasing.
        values: signal ``(T,)``.
        window: rows in a window, odd, from 5 to T.

    Returns:
        Slope ``(T,)`` in units of the signal per second, float64.

    Raises:
        ConfigurationError: if the window is even, below 5 or longer than the signal.

    Reference: Savitzky, Golay, *Smoothing and Differentiation of Data by Simplified Least Squares Procedures*,
    Analytical Chemistry 36 (1964).
    """
    if window % 2 == 0 or not DEGREE < window <= len(time):
        raise ConfigurationError(f"window: an odd number from {DEGREE + 2} to {len(time)} rows wanted, found {window}.")
    return local_motion(time, values, window, DEGREE)[1]


def local_motion(time: Tensor, values: Tensor, window: int, degree: int) -> tuple[Tensor, Tensor]:
    """Free a signal of noise and differentiate it: value and slope of local polynomials; see :func:`local_slope`.

    Args:
        time: clock ``(T,)``, s, increasing.
        values: signal ``(T,)``.
        window: rows in a window, odd, more than ``degree`` and up to T.
        degree: of the polynomials. A higher one follows a wide window more faithfully, and noise too.

    Returns:
        Value and slope, each ``(T,)``, float64.
    """
    time, values = time.double(), values.double()
    steps = torch.diff(time)
    dt = float(steps.median())
    if bool((torch.abs(steps - dt) <= _REGULAR * dt).all()):
        value, slope = (
            savgol_filter(values.numpy(), window, degree, deriv=order, delta=dt, mode="interp") for order in (0, 1)
        )
        return torch.from_numpy(value), torch.from_numpy(slope)
    chunks = torch.arange(len(time)).split(_CHUNK)
    found = torch.cat([_least_squares(time, values, window, degree, rows) for rows in chunks])
    reach = dt * (window // 2)
    return values + found[:, 0], found[:, 1] / reach


def _least_squares(time: Tensor, values: Tensor, window: int, degree: int, rows: Tensor) -> Tensor:
    """Coefficients ``(rows, degree + 1)`` of what comes on top of each row, time in half windows."""
    start = (rows - window // 2).clamp(0, len(time) - window)
    index = start[:, None] + torch.arange(window)
    offset = (time[index] - time[rows, None]) / (torch.diff(time).median() * (window // 2))
    powers = torch.stack([offset**power for power in range(degree + 1)], dim=-1)
    target = values[index] - values[rows, None]
    # by the default, "gelsy", the last digits change from call to call: torch leaves its pivots uninitialised
    return torch.linalg.lstsq(powers, target[..., None], driver="gels").solution[..., 0]
