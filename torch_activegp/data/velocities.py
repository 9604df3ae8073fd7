"""Velocities of recordings that hold positions only."""

from __future__ import annotations

import numpy as np
import torch
from scipy.signal import savgol_coeffs
from torch import Tensor

from torch_activegp.data.local_polynomial import DEGREE, local_slope
from torch_activegp.data.noise import noise_std
from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError

WINDOWS = (5, 7, 9, 13, 17, 25, 35, 49, 69, 97, 137, 193)
_SHARE = 3
_BIAS = 2.0


def estimate_velocities(recording: Recording, window: int | None = None) -> Recording:
    """Add ``qvel.<joint>`` for each joint that has a position and no velocity.

    The velocity is the slope of a cubic fitted to a sliding window, see
    :func:`~torch_activegp.data.local_polynomial.local_slope`; the window is chosen by :func:`choose_window`. It looks
    into the future by half a window, so it is for learning from recordings and not for control.

    Args:
        recording: one run, without leaps of its angles (:func:`~torch_activegp.data.unwrap_angles`).
        window: rows in the window, odd, for all joints; None chooses one for each joint.

    Returns:
        The recording with velocities, rad/s or m/s, and a note that names the windows; the same recording if none is
        missing.

    Raises:
        DataError: if the run is too short to choose a window.
        ConfigurationError: if ``window`` is even, below 5 or longer than the run.

    >>> t = torch.arange(100) * 0.01
    >>> recording = Recording.from_columns("swing", {"time": t, "qpos.elbow": torch.sin(t)})
    >>> velocity = estimate_velocities(recording)["qvel.elbow"]
    >>> bool((velocity - torch.cos(t)).abs().max() < 1e-4)
    True
    """
    missing = [joint for joint in recording.joints if f"qvel.{joint}" not in recording]
    if not missing:
        return recording
    velocities: dict[str, Tensor] = {}
    windows = []
    for joint in missing:
        position = recording[f"qpos.{joint}"]
        rows = window or _choose(recording, position)
        velocities[f"qvel.{joint}"] = local_slope(recording.time, position, rows)
        windows.append(f"{joint} {rows} rows")
    return recording.replace(velocities, f"Velocities are slopes of local cubics over {', '.join(windows)}.")


def choose_window(time: Tensor, values: Tensor, noise: float) -> int:
    """Choose the widest window whose slope differs from the next narrower one's by little more than noise.

    A wider window averages more noise away but flattens what is not a cubic. Windows are tried from 5 rows upwards, in
    steps of about sqrt(2), up to a third of the signal. With slopes v of variance s^2 under white noise, a window is
    accepted while ``mean (v - v_narrower)^2 <= s^2(v - v_narrower) + 2 s^2(v)``: the first term is what noise alone
    does, the second lets the squared bias reach about the variance that is left. The first window that fails ends the
    search.

    Args:
        time: clock ``(T,)``, s.
        values: signal ``(T,)``, T >= 5.
        noise: standard deviation of its white noise, see :func:`~torch_activegp.data.noise.noise_std`.

    Returns:
        An odd number of rows.

    Reference: Goldenshluger, Nemirovski, *On Spatially Adaptive Estimation of Nonparametric Regression*, Mathematical
    Methods of Statistics 6 (1997), whose rule is applied here to the whole signal at once.
    """
    dt = float(torch.diff(time).median())
    best = WINDOWS[0]
    narrower, narrower_weights = local_slope(time, values, best), _weights(best, dt)
    for window in (rows for rows in WINDOWS[1:] if rows <= len(values) // _SHARE):
        slope, weights = local_slope(time, values, window), _weights(window, dt)
        half = window // 2
        inner = (slope - narrower)[half:-half]
        pad = (window - best) // 2
        by_noise = ((weights - np.pad(narrower_weights, pad)) ** 2).sum()
        if float((inner**2).mean()) > noise**2 * (by_noise + _BIAS * (weights**2).sum()):
            break
        best, narrower, narrower_weights = window, slope, weights
    return best


def _choose(recording: Recording, position: Tensor) -> int:
    if len(recording) < 3 * WINDOWS[0]:
        raise DataError(
            f"{recording.label}: too short for velocities, {3 * WINDOWS[0]} rows wanted, found {len(recording)}. "
            "Record longer, give a `window`, or record the velocity."
        )
    return choose_window(recording.time, position, noise_std(position, recording.time))


def _weights(window: int, dt: float) -> np.ndarray:
    """Weights ``(window,)`` of the rows in the slope at the middle of a window."""
    return savgol_coeffs(window, DEGREE, deriv=1, delta=dt)
