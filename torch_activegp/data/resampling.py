"""Recordings at another, coarser time step."""

from __future__ import annotations

import numpy as np
import torch

from torch_activegp.data.checks import MIN_ROWS
from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError

_TOLERANCE = 1e-3


def resample(recording: Recording, dt: float) -> Recording:
    """Bring a recording to a uniform, coarser clock.

    Positions and velocities are the recorded ones at the new times, interpolated linearly and not smoothed, so that an
    error measured against them is an error against what was measured. Controls and external forces were held from
    row to row, so their mean over the new step is what acted in it. Estimate velocities first: a fine clock tells
    them better.

    Args:
        recording: one run, without leaps of its angles (:func:`~torch_activegp.data.unwrap_angles`); its clock may be
            irregular.
        dt: new time step, s, at least the recording's own.

    Returns:
        Rows at ``time[0] + k dt``, as many as the run has room for.

    Raises:
        DataError: if the step is finer than the recording's own, or leaves fewer than 4 rows.

    >>> columns = {"time": torch.arange(9) * 0.5, "qpos.x": torch.arange(9.0), "ctrl.u": torch.arange(9.0)}
    >>> coarse = resample(Recording.from_columns("ramp", columns), dt=1.0)
    >>> coarse["qpos.x"].tolist(), coarse["ctrl.u"].tolist()
    ([0.0, 2.0, 4.0, 6.0, 8.0], [0.5, 2.5, 4.5, 6.5, 8.0])
    """
    if not dt >= recording.dt * (1 - _TOLERANCE):
        raise DataError(
            f"{recording.label}: a step of at least {recording.dt:.6g} s (its own) wanted, found {dt:.6g} s."
        )
    time = recording.time.numpy()
    count = int(np.floor((time[-1] - time[0]) / dt + _TOLERANCE)) + 1
    if count < MIN_ROWS:
        raise DataError(
            f"{recording.label}: a step of {dt:.6g} s leaves {count} rows of {time[-1] - time[0]:.6g} s, at least "
            f"{MIN_ROWS} wanted. Use a smaller step or a longer run."
        )
    clock = time[0] + dt * np.arange(count)
    columns = {"time": torch.from_numpy(clock)}
    for name in recording.columns[1:]:
        values = recording[name].numpy()
        held = name.startswith(("ctrl.", "qfrc."))
        columns[name] = torch.from_numpy(
            _held_mean(time, values, clock, dt) if held else np.interp(clock, time, values)
        )
    note = f"Resampled from {recording.dt:.6g} s to {dt:.6g} s."
    return Recording.from_columns(
        recording.name,
        columns,
        run=recording.run,
        source=recording.source,
        notes=(*recording.notes, note),
        prescribed=recording.prescribed,
        video=recording.video,
    )


def _held_mean(time: np.ndarray, values: np.ndarray, clock: np.ndarray, dt: float) -> np.ndarray:
    """Mean over ``[clock, clock + dt]`` of a signal that holds each value until the next row, and the last for ever."""
    edges = np.append(time, max(time[-1], clock[-1]) + 2 * dt)
    integral = np.append(0.0, np.cumsum(values * np.diff(edges)))
    return (np.interp(clock + dt, edges, integral) - np.interp(clock, edges, integral)) / dt
