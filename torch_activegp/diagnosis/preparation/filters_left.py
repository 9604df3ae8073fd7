"""Steep filters that show in what the nominal leaves, where the motion hides them in the recordings themselves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import signal
from scipy.special import comb

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Array, Run, median_step
from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.diagnosis.noise.floor import INNER, noise_floor, uneven
from torch_activegp.diagnosis.noise.periods import noise_from_periods
from torch_activegp.diagnosis.noise.shelf import LOWEST, shelf
from torch_activegp.diagnosis.preparation.given_numerics import numerics_of
from torch_activegp.diagnosis.preparation.lengths import followed

_ORDERS, _SMOOTH = np.array([4, 8]), 1.5
"""Behind a filter of the fourth order or more, differences of the higher order saw 2.4 to 9 times less, and 1.0 to 1.2
times less in white noise and behind one pole."""
_DEEPEST = 2.5
"""Decades below the level of the noise that segments as short as these tell."""
_MOSTLY_ROUNDING, _LOUDER, _FAR_LOUDER, _JUST_ABOVE, _WINDOW = 0.5, 4.0, 100.0, 1.5, 256
"""Part of the variance that differences see which rounding must be; times that, or other white noise, by which a
spectrum of so many rows must be louder from the lowest corner up to so many times that."""
_SAME_VALUE, _OFF_GRID = 1e-9, 0.05
"""Part of the range below which two values are the same, and of a step by which they may be off a grid, for they were
written with so many digits."""
_GROWING = (0.001, 0.01, 0.1)
"""Parts of the range in which a step is told, each by the one before."""
_SEGMENTS, _ROWS = 8, 40
"""Fewer segments that are whole, or shorter ones, say too little."""
_COHERENT = 0.5
"""Coherence with a louder motion from which on a rest is a part of that and no noise: of a chirp, whose spectrum is
level up to where it ends, an encoder's gain that is off leaves a part. What a loop makes of noise is coherent, but
quieter."""


def filters_left(machine: Machine, nthread: int = 0) -> list[SteepFilter | None]:
    """For each channel the filter that what the nominal leaves seems to have passed; None where there is none.

    A loop that moves a machine up to the corner of its filter leaves no level noise to see that by, nor do recordings
    at 50 Hz. The nominal knows nearly all of that motion. Of a cart and pole that were filtered forth and back at 22 Hz
    the noise was taken for a tenth of what it was, of a buoy at 14 Hz for a tenth; what the nominal left was level up
    to there, though it missed a spring and a drag of 16 times the noise.

    Segments in which rows are missing say nothing. Those of a second tell corners from 12 Hz on.

    Args:
        machine: model and runs.
        nthread: threads of the simulations; 0 for all cores.
    """
    channels = range(len(machine.channels.joints))
    white = [white_behind(machine.fit, channel) for channel in channels]
    asked = [channel for channel in channels if white[channel] > 0.0 or is_smooth(machine.fit, channel)]
    found: list[SteepFilter | None] = [None for _ in channels]
    if not asked:
        return found
    shooting, fit = followed(machine, numerics_of(machine, nthread), noise_floor(machine.fit))
    predicted, counts = shooting.predicted(fit), shooting.segments.counts
    left, rows = shooting.segments.position - predicted, int(np.median(counts.sum(axis=1)))
    pieces = [(number, np.flatnonzero(some)[:rows]) for number, some in enumerate(counts)]
    whole = [(number, at) for number, at in pieces if len(at) == rows and np.ptp(at) == rows - 1]
    if rows < _ROWS or len(whole) < _SEGMENTS or not np.isfinite(left[counts]).all():
        return found
    frequency, lowest = np.asarray(np.fft.rfftfreq(rows), dtype=np.float64)[INNER], LOWEST * median_step(machine.fit)
    for channel in asked:
        rest, motion = (_spectra([some[*piece, channel] for piece in whole]) for some in (left, predicted))
        found[channel] = _filter(rest, motion, frequency, lowest, white[channel])
    return found


def is_smooth(runs: Sequence[Run], channel: int) -> bool:
    """Whether high differences of the positions see much less than lower ones, as behind a steep filter.

    Not asked of videos, of uneven clocks, and where the excitation repeats.
    """
    if any(run.video or uneven(run) for run in runs):
        return False
    sizes = [[np.median(np.abs(np.diff(run.position[:, channel], order))) for order in _ORDERS] for run in runs]
    lower, higher = np.median(sizes, axis=0) / np.sqrt(comb(2 * _ORDERS, _ORDERS))
    return bool(lower > _SMOOTH * higher > 0.0) and noise_from_periods(runs, channel) is None


def white_behind(runs: Sequence[Run], channel: int) -> float:
    """Density, at unit sampling rate, of white noise that came behind a filter, if one may be hidden; 0 where not.

    Positions that were filtered before a coarse encoder rounded them have the white noise of that in all their
    differences, and a level one beneath, of 0.94 mrad up to 25 Hz behind steps of 0.77: a simulator without any fault
    left 16 times the noise. White noise of another origin hides one as well, if it is far quieter: 0.03 mm behind
    0.3 mm up to 15 Hz, of which such a simulator left 86 times the noise. Not asked of videos, of uneven clocks, of
    what is smooth without rounding, and where what is as quick as the lowest corner is not so much louder.
    """
    if any(run.video or uneven(run) for run in runs):
        return 0.0
    moves = [values for run in runs if np.ptp(values := run.position[run.counted, channel]) > 0.0]
    step = min((resolution(values) for values in moves), default=0.0)
    rounding, step_of_rows = 2.0 * step**2 / 12.0, median_step(runs)
    white = 2.0 * float(np.median([run.noise[channel] ** 2 for run in runs]))
    rounded = _MOSTLY_ROUNDING * white < rounding
    if not rounded and is_smooth(runs, channel):
        return 0.0
    density, louder = (rounding, _LOUDER) if rounded else (white, _FAR_LOUDER)
    rows = min(_WINDOW, min(map(len, runs)))
    frequency = np.asarray(np.fft.rfftfreq(rows), dtype=np.float64)[INNER]
    power = np.median(np.abs(_spectra([run.position[:rows, channel] for run in runs])) ** 2, axis=0)
    band = (frequency > LOWEST * step_of_rows) & (frequency < _JUST_ABOVE * LOWEST * step_of_rows)
    return density if band.any() and np.median(power[band]) > louder * density else 0.0


def resolution(values: Array) -> float:
    """The step in which values were rounded, such as a count of an encoder; 0 where there is none."""
    apart = np.diff(np.unique(values))
    least = _SAME_VALUE * float(np.ptp(values))
    step = float(apart[apart > least].min(initial=np.inf))
    if not np.isfinite(step):
        return 0.0
    away = np.sort(np.abs(values - values[0]))
    for end in (*_GROWING, 1.0):  # a step as it was written errs more the more of them are counted
        near = away[away <= end * away[-1]]
        counts = np.rint(near / step)
        step = float(counts @ near / (counts @ counts)) if counts.any() else step
    off = np.abs(away / step - np.rint(away / step))
    return step if off.max() < _OFF_GRID else 0.0


def _spectra(pieces: Sequence[Array]) -> NDArray[np.complex128]:
    """Spectra ``(n, F)`` of n pieces of as many rows."""
    window = signal.windows.blackmanharris(len(pieces[0]), sym=False)
    return np.fft.rfft(signal.detrend(pieces) * window * np.sqrt(2.0 / (window**2).sum()))[:, INNER]


def _filter(
    rest: NDArray[np.complex128], motion: NDArray[np.complex128], frequency: Array, lowest: float, white: float = 0.0
) -> SteepFilter | None:
    """The filter that spectra ``(n, F)`` of a rest show, if that is no part of the motion, beneath a white noise."""
    power, moved = (np.median(np.abs(some) ** 2, axis=0) / np.log(2.0) for some in (rest, motion))  # chi-squared of two
    found = shelf(frequency, power, lowest, _DEEPEST, white)
    if found is None:
        return None
    shared = np.abs((rest * motion.conj()).mean(axis=0)) ** 2
    coherence = shared / ((np.abs(rest) ** 2).mean(axis=0) * (np.abs(motion) ** 2).mean(axis=0))
    level = frequency < found.corner
    is_a_part = (coherence > _COHERENT) & (power < moved)
    return None if is_a_part[level].mean() >= 0.5 else found
