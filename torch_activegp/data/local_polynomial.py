"""Value and slope of a sampled signal from polynomials fitted to a sliding window."""

from __future__ import annotations

import torch
from scipy.signal import savgol_filter
from torch import Tensor

from torch_activegp.errors import ConfigurationError

DEGREE = 3
_REGULAR = 1e-3
_CHUNK = 4096
_POOR = 1e-3
"""Least over largest pivot of normal equations that lose more than half of the digits."""


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
    centres = (torch.arange(len(time)) - window // 2).clamp(0, len(time) - window) + window // 2
    windows = torch.arange(len(time) - window + 1).split(_CHUNK)
    found = torch.cat([_least_squares(time, values, window, degree, start) for start in windows])
    coefficients = found[centres - window // 2]
    reach = 0.5 * (time[centres + window // 2] - time[centres - window // 2])
    place = (time - time[centres]) / reach
    order = torch.arange(1, degree + 1)
    powers = torch.linalg.vander(place, N=degree + 1)
    slopes = (order * coefficients[:, 1:] * powers[:, :-1]).sum(-1) / reach
    return values[centres] + (coefficients * powers).sum(-1), slopes


def _least_squares(time: Tensor, values: Tensor, window: int, degree: int, start: Tensor) -> Tensor:
    """Polynomials ``(windows, degree + 1)`` on top of the value in the middle row of each window, time in half windows.

    By the normal equations, a fifth of the time of an orthogonal factorisation; where a pause in a window makes them
    ill-conditioned, by that.
    """
    rows = start[:, None] + torch.arange(window)
    middle = start + window // 2
    reach = 0.5 * (time[start + window - 1] - time[start])
    place = (time[rows] - time[middle, None]) / reach[:, None]
    target = values[rows] - values[middle, None]
    moments, along, power = [], [], torch.ones_like(place)
    for order in range(2 * degree + 1):
        moments.append(power.sum(-1))
        if order <= degree:
            along.append((power * target).sum(-1))
        power = power * place
    right, moment = torch.stack(along, dim=-1)[..., None], torch.stack(moments, dim=-1)
    factor, failed = torch.linalg.cholesky_ex(moment.unfold(-1, degree + 1, 1))
    pivots = factor.diagonal(dim1=-2, dim2=-1)
    poor = (failed > 0) | ~(pivots.amin(-1) > _POOR * pivots.amax(-1))
    factor[poor] = torch.eye(degree + 1, dtype=factor.dtype)
    solution = torch.cholesky_solve(right, factor)
    if poor.any():
        powers = torch.linalg.vander(place[poor], N=degree + 1)
        # by the default, "gelsy", the last digits change from call to call: torch leaves its pivots uninitialised
        solution[poor] = torch.linalg.lstsq(powers, target[poor, :, None], driver="gels").solution
    return solution[..., 0]
