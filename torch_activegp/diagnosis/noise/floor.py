"""The noise of recorded positions from the recordings alone: level from differences, colour from the spectrum."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy import signal

from torch_activegp.diagnosis.inputs.runs import Array, Run, median_step
from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.diagnosis.noise.model import NoiseModel, colour_family, colour_scale, high_differences, spectrum
from torch_activegp.diagnosis.noise.periods import noise_from_periods
from torch_activegp.diagnosis.noise.shelf import LOWEST, shelf, shelf_behind, shelf_beside
from torch_activegp.diagnosis.noise.video import video_errors

_WINDOW = 128
INNER = slice(4, -2)
"""Bins that the window does not smear."""
_BIN = 1.0
"""Bins of the spectrum in which a steep filter is sought are about so wide, Hz, where the runs are long enough."""
_LOWEST = 0.125
_MOTION = 20.0
"""Machines move more slowly than this, Hz, and below an eighth of the sampling rate; above there is noise."""
_NARROW = 0.3
_COLOURED = 0.4
_SHOWN = 1.2
"""A colour may show so much more variance to high differences than they see: 0.7 to 1.15 times for filtered noise, 1.3
for the motion of a tight loop and 1.9 for a limit cycle in a backlash, recorded at 100 Hz."""
_STEEPER = 0.15
"""Logarithm by which the lower third of a band may be louder than any colour says that is as close to the rest of it:
-1.1 to 0.0 for filtered noise, 0.2 to 2.6 where the motion of a quick servo or of a whirling arm reached into the band.
Its noise was taken for 40 to 1200 times what it was."""
_AS_CLOSE = (1.3, 0.01)
"""So much more misfit than the least, times and plus, is as close."""
_OF_MOTION, _RESTS = 0.1, 0.2
"""Part of the motion from which on noise of two poles is that motion, which falls alike, unless the band has so much of
its variance: a joint that rests has nothing but noise. Five joints of 900 had floors of 0.38 to 0.47 of it, 57 to 116
times their noise, others of two poles 0.034 at most; a hammer's, of 0.2 and 79, hid a load of 7 times the noise."""
_JOINTS = 3
_COMPLETE, _JITTER = 0.9, 0.02
_FINEST = 3e-5
_GROWS = 1.5
"""What a displacement of a prescribed joint becomes on its way through a segment, beyond what inertia makes of it."""


def noise_floor(runs: Sequence[Run]) -> NoiseModel:
    """Noise level and colour of every channel, without a model of the machine.

    High differences measure white noise. A filter in the encoder makes noise whose differences are small though its
    level is not; it shows in the spectrum above the machine's motion, which is flat for white noise. A steep filter
    shows in a spectrum that is flat up to its corner; rows as far apart as that tells have white noise again
    (:func:`steep_filters`). Recordings slower than 67 Hz leave no such band: their noise counts as white, unless they
    are said to be videos, whose errors last. Where the controls repeat and the motion has settled, noise is what
    differs from period to period, and neither is asked. No floor is below 3e-5 of the motion: rigid bodies, and the
    arithmetic that simulates them, are no more exact than that. The noise of prescribed joints moves the others in a
    simulation, and comes on top of theirs.

    Args:
        runs: at least one.
    """
    own = _own(runs, finest(runs))
    return NoiseModel(np.hypot(own.scale, _carried(runs)), own.colour)


def hides_filters(runs: Sequence[Run], channel: int) -> bool:
    """Whether a filter in an encoder would show nowhere in the recordings.

    They are too slow, too short, too uneven or miss too many rows for a spectrum above the motion, or that goes on to
    the end of the spectrum; no excitation repeats, and they are not said to be videos.
    """
    if any(run.video for run in runs) or noise_from_periods(runs, channel) is not None:
        return False
    if steep_filters(runs)[channel] is not None:
        return False
    unseen = _lowest(runs) > _NARROW or all(uneven(run) or _spectrum(run, channel) is None for run in runs)
    return unseen or moves_quickly(runs, channel)


def moves_quickly(runs: Sequence[Run], channel: int) -> bool:
    """Whether the motion goes on to the end of the spectrum; then differences may see more than the noise too."""
    band = _above_motion(runs, channel)
    return band is not None and band.moves


def steep_filters(runs: Sequence[Run]) -> list[SteepFilter | None]:
    """For each channel the filter that took so much from the end of the spectrum that what is left looks like motion.

    Where the motion hides that the noise is level, those of other joints are tried, for joints are filtered alike; and
    where each is hidden, that which the joints show together. Those of the runs where they were looked for already.
    """
    if runs[0].filters is not None:
        return [*runs[0].filters]
    channels = range(runs[0].position.shape[1])
    wanted = [c for c in channels if _may_be_steep(runs, c)]
    own = {c: _steep(runs, c, partial(shelf, lowest=LOWEST * median_step(runs))) for c in wanted}
    known = [one for one in own.values() if one is not None] or _together(runs, wanted)
    return [own[c] or _behind_another(runs, c, known) if c in own else None for c in channels]


def filter_beside(runs: Sequence[Run], channel: int, shown: Sequence[SteepFilter | None]) -> SteepFilter | None:
    """The filter of a channel that shows none, by the first other one to whose spectrum its own is in proportion.

    Args:
        runs: at least one.
        channel: which of the recorded positions.
        shown: for each channel the filter that it shows, or None.
    """
    if not _may_be_steep(runs, channel) or (here := _spectra(runs, channel)) is None:
        return None
    seen = ((one, _spectra(runs, c)) for c, one in enumerate(shown) if one is not None)
    levels = (shelf_beside(*here[:2], there[1], one) for one, there in seen if there is not None)
    return next((one for one in levels if one is not None), None)


def _behind_another(runs: Sequence[Run], channel: int, known: Sequence[SteepFilter]) -> SteepFilter | None:
    """The first of some filters that a channel is behind, in all runs or in one."""
    found = (
        _steep(some, channel, partial(shelf_behind, known=one))
        for one in known
        for some in (runs, *([r] for r in runs))
    )
    return next((one for one in found if one is not None), None)


def _together(runs: Sequence[Run], channels: Sequence[int]) -> list[SteepFilter]:
    """The filters that the joints of single runs show together, least noise first; none of fewer than three joints.

    Motion up to the corner leaves few level bins, which scatter in a run of five seconds; and runs move by different
    amounts. On an arm of seven joints at 100 Hz noise of 0.36 mrad was taken for 0.03, and the right names left 307
    times that.
    """
    found = []
    for run in runs:
        each = ((c, _spectrum(run, c)) for c in channels)
        spectra = [seen for c, seen in each if seen is not None and seen[1].min() > _rounding([run], c)]
        if len(spectra) < _JOINTS:
            continue
        levels = np.log([power for _, power in spectra])
        typical = np.array_split(levels, 3, axis=1)[0].mean(axis=1, keepdims=True)
        pooled = np.exp(np.median(levels - typical, axis=0) + typical.mean())
        one = shelf(spectra[0][0], pooled, LOWEST * median_step(runs))
        found += [] if one is None else [one]
    return sorted(found, key=lambda one: one.scale)


def _may_be_steep(runs: Sequence[Run], channel: int) -> bool:
    """Whether a channel is no video, repeats nothing, and its spectrum goes on like motion to the end."""
    if any(run.video for run in runs) or noise_from_periods(runs, channel) is not None:
        return False
    band = _above_motion(runs, channel)
    return _lowest(runs) <= _NARROW and (band is None or band.moves)


def _steep(runs: Sequence[Run], channel: int, seek: Callable[[Array, Array], SteepFilter | None]) -> SteepFilter | None:
    """What is found in the spectrum of a channel, in bins as narrow as the runs allow first."""
    step = median_step(runs)
    fine = _WINDOW * 2 ** max(round(np.log2(_BIN**-1 / (_WINDOW * step))), 0)
    while fine >= _WINDOW:
        seen = _spectra(runs, channel, fine)
        found = None if seen is None else seek(*seen[:2])
        if found is not None:
            return found
        fine //= 2
    return None


def _motion(runs: Sequence[Run]) -> Array:
    """The standard deviation of each channel within runs, ``(C,)``, rad or m."""
    return np.asarray(np.sqrt(np.mean([run.position.var(axis=0) for run in runs], axis=0)))


def finest(runs: Sequence[Run]) -> Array:
    """The least noise of each channel, ``(C,)``: a part of the motion within runs."""
    return _FINEST * _motion(runs)


def _own(runs: Sequence[Run], least: Array | float = 0.0) -> NoiseModel:
    """Noise of the channels themselves."""
    scale = np.maximum(np.sqrt(np.mean([run.noise**2 for run in runs], axis=0)), least) + 1e-12
    colour, steep = np.zeros((len(scale), 2)), steep_filters(runs)
    for channel in range(len(scale)):
        found = noise_from_periods(runs, channel) or video_errors(runs, scale[channel]) or _colour(runs, channel)
        if found is not None:
            colour[channel], scale[channel] = found
        elif (filtered := steep[channel]) is not None:
            scale[channel] = filtered.scale
    return NoiseModel(np.asarray(scale), colour)


def _carried(runs: Sequence[Run]) -> Array | float:
    """What the noise of prescribed joints adds to each channel, ``(C,)``."""
    given = [run.prescribed for run in runs if run.prescribed is not None]
    coupling = [run.coupling for run in runs if run.coupling is not None]
    if not given:
        return 0.0
    return np.asarray(_GROWS * np.sqrt(np.mean(np.square(coupling), axis=0) @ _own(given).scale ** 2))


def _colour(runs: Sequence[Run], channel: int) -> tuple[tuple[float, float], float] | None:
    """The poles whose spectrum is closest, and the noise's standard deviation; None for white noise, and in doubt."""
    band = _above_motion(runs, channel)
    if band is None or band.moves or not any(band.poles):
        return None
    return band.poles, band.level / colour_scale(band.poles)


class _Band(NamedTuple):
    """A band above the motion: the closest poles, the level of what is new, and whether motion is in it too."""

    poles: tuple[float, float]
    level: float
    moves: bool


def _above_motion(runs: Sequence[Run], channel: int) -> _Band | None:
    """The band that a noise of some colour is seen in, None where there is none.

    Impacts, quick servos and tight loops move a machine in it too. Such a motion is no noise of any colour: one as loud
    would show more to high differences than there is, or be much of the motion, or this falls off more steeply.
    """
    seen, lowest = _spectra(runs, channel), _lowest(runs)
    if seen is None or lowest > _NARROW:
        return None
    (frequency, power, level), whole = seen, _motion(runs)[channel]
    rests = power.sum() > _RESTS * _WINDOW * whole**2
    frequency, power = frequency[frequency >= lowest], power[frequency >= lowest]
    if power.min() <= _rounding(runs, channel):
        return None
    poles, new = _closest(frequency, power)
    shown = new**2 * high_differences(poles)
    loud = poles[1] != 0.0 and not rests and new > _OF_MOTION * whole * colour_scale(poles)
    return _Band(poles, new, loud or shown > _SHOWN * level or _moves(frequency, power))


def _rounding(runs: Sequence[Run], channel: int) -> float:
    """A power that is rounding alone, as where a joint rests."""
    return float(1e-20 * max(float(np.abs(run.position[:, channel]).max()) for run in runs) ** 2)


def _moves(frequency: Array, power: Array) -> bool:
    """Whether a band is louder at its lower end than any colour says that is as close to the rest of it as another.

    Force moves a mass by less the quicker it changes: much as two poles near one would filter noise, but more steeply
    at the lower end, where the noise is not seen yet.
    """
    lower = frequency < frequency[0] + (frequency[-1] - frequency[0]) / 3
    apart = [np.log(power) - np.log(spectrum(poles, frequency)) for poles in colour_family()]
    misfit = np.array([float(each[~lower].var()) for each in apart])
    times, plus = _AS_CLOSE
    close = misfit < times * misfit.min() + plus
    louder = [float(each[lower].mean() - each[~lower].mean()) for each, near in zip(apart, close, strict=True) if near]
    return min(louder) > _STEEPER


def _closest(frequency: Array, power: Array) -> tuple[tuple[float, float], float]:
    """The poles whose spectrum is closest to a power in some band, and the standard deviation of what is new."""
    lower, upper = np.array_split(power, 3)[0], np.array_split(power, 3)[-1]
    coloured = abs(np.log(lower.mean() / upper.mean())) >= _COLOURED
    misfits = {}
    for poles in colour_family() if coloured else [(0.0, 0.0)]:
        apart = np.log(power) - np.log(spectrum(poles, frequency))
        misfits[poles] = (float(apart.var()), float(apart.mean()))
    poles = min(misfits, key=lambda key: misfits[key][0])
    # a one-sided density at unit sampling rate: white noise of variance v has 2 v
    return poles, float(np.sqrt(np.exp(misfits[poles][1]) / 2.0))


def _lowest(runs: Sequence[Run]) -> float:
    """Where the band above the machine's motion begins, in parts of the sampling rate."""
    return max(_LOWEST, _MOTION * median_step(runs))


def uneven(run: Run) -> bool:
    """Whether a run is sampled at uneven times; what is left of its motion hides part of the noise then."""
    return bool(np.ptp(run.dt) > _JITTER * np.median(run.dt))


def _spectra(runs: Sequence[Run], channel: int, window: int = _WINDOW) -> tuple[Array, Array, float] | None:
    """Frequencies, the median spectrum of all runs that have one, and the median variance by differences in these."""
    found = [(run, s) for run in runs if (s := _spectrum(run, channel, window)) is not None]
    if not found:
        return None
    power = np.median([p for _, (_, p) in found], axis=0)
    return found[0][1][0], power, float(np.median([run.noise[channel] ** 2 for run, _ in found]))


def _spectrum(run: Run, channel: int, window: int = _WINDOW) -> tuple[Array, Array] | None:
    if run.recorded.mean() < _COMPLETE or len(run) < 2 * window:
        return None
    values = run.position[:, channel]
    if uneven(run):  # sampled at uneven times, a motion looks like noise: take it out
        speed = run.velocity[:, channel]
        values = values - np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * run.dt)])
    frequency, power = signal.welch(
        values, window="blackmanharris", nperseg=window, detrend=signal.detrend, average="median"
    )
    return frequency[INNER], power[INNER]
