"""The noise of recorded positions from runs whose controls repeat: what differs from period to period is noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from torch_activegp.data.noise import quantum
from torch_activegp.diagnosis.inputs.runs import Array, Run
from torch_activegp.diagnosis.noise.model import colour_scale, is_white, likeliest

_SHORTEST = 20
_PERIODS = 3
_LEAST = 100
"""Fewer rows of differences, over all runs, say too little."""
_EXACT = 1e-9
_FINE = 0.01
_JITTER = 0.02
_SHRINKS = 1.25
_APART, _NEAR = -0.5, 0.25
"""Differences of noise between neighbouring periods correlate by about -0.5, those of what settles slowly by up to 1,
those of what alternates by -1; those two periods apart do not correlate."""
_BLOCKS = 4
"""Differences of fewer periods say nothing about those two periods apart."""
_CLOCK = 0.3
"""What the clock's drift over a period moves the machine by stays below this part of the noise."""
_CHAOS = 0.1
_FINEST = 3e-5
"""Noise is between these parts of the motion: below, arithmetic differs; above, the motion itself does not repeat."""


def noise_from_periods(runs: Sequence[Run], channel: int) -> tuple[tuple[float, float], float] | None:
    """Colour and level of one channel's noise from differences between periods.

    Where the controls repeat and the motion has settled, the motion repeats too, however fast it is: half the variance
    of the difference is the noise's, at all frequencies, and for slow recordings too. In doubt there is no answer, and
    differences within the signal decide, which need no assumption about the machine: where the motion still settles or
    drifts, does not repeat (a chaotic one) or only after two periods, where the clock is too uneven for its speed, is
    quantised more coarsely than the noise, or where the difference is not of a colour that a filter in an encoder
    gives. Controls that a loop makes from noisy positions do not repeat.

    Args:
        runs: at least one.
        channel: which of the recorded positions.

    Returns:
        Coefficients of the last two values, zero for white noise, and the standard deviation; or None.
    """
    found = [(run, series) for run in runs if (series := _settled(run, channel)) is not None]
    count = sum(len(series) for _, series in found)
    if count < _LEAST:
        return None
    poles = likeliest(lambda poles: _innovation(found, poles), count)
    scale = float(np.sqrt(_innovation(found, poles)) / colour_scale(poles))
    motion = min(float(run.position[:, channel].std()) for run, _ in found)
    step = max(quantum(torch.from_numpy(np.sqrt(2.0) * series)) for _, series in found)
    if not max(step, _FINEST * motion) < scale < _CHAOS * motion or not is_white(
        [_fresh(series, poles) for _, series in found]
    ):
        return None
    if max(_clock_error(run, channel) for run, _ in found) > _CLOCK * scale:
        return None
    return poles, scale


Found = Sequence[tuple[Run, Array]]


def _fresh(series: Array, poles: tuple[float, float]) -> Array:
    """What is new in each value."""
    return np.asarray(series[2:] - poles[0] * series[1:-1] - poles[1] * series[:-2])


def _innovation(found: Found, poles: tuple[float, float]) -> float:
    """Variance of what is new in each value."""
    return float(np.mean(np.concatenate([_fresh(series, poles) for _, series in found]) ** 2)) + 1e-300


def _settled(run: Run, channel: int) -> Array | None:
    """Differences from period to period over the square root of 2, in a row, where the motion has settled."""
    repeat = repetition(run)
    if repeat is None:
        return None
    first, period = repeat
    position = run.position[first:, channel]
    differences = (position[period:] - position[:-period]) / np.sqrt(2.0)
    blocks = differences[len(differences) % period :].reshape(-1, period)  # the last ones are the most settled
    least = _BLOCKS if len(blocks) >= _BLOCKS else 2  # of so few, some look like noise by chance
    for start in range(len(blocks) - least + 1):
        rest = blocks[start:]
        level = (rest**2).mean(axis=1)
        if level[0] <= _SHRINKS**2 * level[1:].mean() and _differs_like_noise(rest):
            return np.asarray(rest.ravel())
    return None


def _differs_like_noise(blocks: Array) -> bool:
    """Whether differences between neighbouring periods, one a row, correlate as those of noise do."""
    if abs(_alike(blocks, 1) - _APART) > _NEAR:
        return False
    return len(blocks) < _BLOCKS or abs(_alike(blocks, 2)) < _NEAR


def _alike(blocks: Array, lag: int) -> float:
    late, early = blocks[lag:], blocks[:-lag]
    return float((late * early).sum() / max(np.sqrt((late**2).sum() * (early**2).sum()), 1e-300))


def _clock_error(run: Run, channel: int) -> float:
    """How far the machine typically moves in the time by which periods differ in length."""
    repeat = repetition(run)
    if repeat is None:
        return 0.0
    first, period = repeat
    lengths = run.time[first + period :] - run.time[first:-period]
    return float(lengths.std() * np.sqrt(np.mean(run.velocity[first:, channel] ** 2)))


def repetition(run: Run) -> tuple[int, int] | None:
    """The row from which controls and external forces repeat to the end, and the rows of a period, the shortest.

    Returns:
        None where there are not at least three periods of 20 rows, evenly timed and without a gap, or nothing changes.
    """
    inputs = np.concatenate([run.control, run.force], axis=1)
    inputs = inputs[:, np.ptp(inputs, axis=0) > 0.0]
    if not inputs.size or not run.recorded.all() or np.ptp(run.dt) > _JITTER * np.median(run.dt):
        return None
    rows, near = len(inputs), _FINE * np.ptp(inputs, axis=0)
    still = rows - 1 - int(np.flatnonzero((np.abs(inputs - inputs[-1]) > near).any(axis=1))[-1])
    for period in range(max(_SHORTEST, still), rows // _PERIODS + 1):  # no period is shorter than a standstill in it
        probes = np.arange(1, period + 1, max(period // 8, 1))
        if (np.abs(inputs[-probes] - inputs[-probes - period]) > near).any():
            continue
        apart = np.abs(inputs[period:] - inputs[:-period])
        first = int(np.max(np.flatnonzero((apart > near).any(axis=1)), initial=-1)) + 1
        varied = (np.ptp(inputs[first:], axis=0) > near).all()
        if rows - first >= _PERIODS * period and varied and _is_equal(apart[first:], near):
            return first, period
    return None


def _is_equal(apart: Array, near: Array) -> bool:
    """Whether distances ``(K, A)`` are zero, or one step of what records them, which is below ``near``."""
    exact = _EXACT / _FINE * near
    step = np.where(apart > exact, apart, np.inf).min(axis=0)
    return bool((apart <= np.where(np.isfinite(step), 1.02 * step, exact)).all())
