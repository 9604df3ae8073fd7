"""The noise of recorded positions from what a fit leaves, where that is clearly another than was thought."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.noise.floor import finest, hides_filters, moves_quickly
from torch_activegp.diagnosis.noise.model import (
    SEEN,
    NoiseModel,
    colour_scale,
    high_differences,
    is_white,
    likeliest,
)
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_LESS = 0.9
"""Noise is taken anew where its variance falls to less than this part: floors are known to a few percent."""
_STANDS_IN = 0.5
"""The same of what is new where what is left is no noise of any colour, and the closest one stands in for a while. It
was 0.32 where a tight loop at 100 Hz made a floor of 7 mm of noise of 0.06 mm, which hid a gain of 98 times the noise.
"""
_LEAST = 200
"""Fewer values of a channel say too little."""
_SAME_HIGH = (0.8, 1.25)
"""A colour explains a floor where the variance that it shows to high differences is that of the floor, times this:
1.0 to 1.15 for filtered noise behind dropped rows, 0.65 to 0.8 for what physics left beside white noise."""
_FRESH, _LAGS = 0.12, 15
"""And where what is new correlates with what was new up to so many values before by less: 0.07 for filtered noise, 0.2
to 0.3 for physics. A periodic error shows after a period."""
_STRICTLY_HIGH, _STRICTLY_FRESH, _SLOWEST = (0.85, 1.25), 0.07, 0.85
"""The same behind names where a spectrum should have shown the filter, and the largest pole: a tight loop moved up to
the rates at which it would, or it showed a quicker filter and too little noise. What was left behind one to three names
showed 0.94 to 1.12 and 0.06 there, and 1.23 and 0.07 beside a floor of a pole of 0.4 for one of 0.65; behind none, what
they explain showed 1.06 and 0.08, at a pole of 0.94."""
_LESS_HIGH = (0.2, 1.25)
"""For the variance, beside a motion that high differences see too: a servo's at 250 Hz showed 1.4 and 3.4 times the
noise."""
_CHANCE = 4.0
"""Standard deviations of what chance makes of a correlation."""
_RISES = 0.7
"""Logarithm by which what is left must be louder at some frequency than at lower ones to be no filter's noise: at most
0.34 of noise, white or behind 56 filters, and 8 of a force that shook an arm at 7.3 Hz."""
_CHANCE_RISE = 4.5
"""Five standard deviations of such a logarithm, times the root of values over lags."""
_FAR, _APART, _ABSORBED, _LITTLE = (60, 150), 8, 3.0, 1e-4
"""Lags of its autocovariance, frequencies from one to those that are clearly lower, periods in a segment that initial
states absorb much of, and part of the largest power that is none. By 60 lags a force at 5 Hz, recorded at 250 Hz, is
told from none below by a factor of 0.7, and by 143 of 8; of it a force in bins of 0.2 s sees a fifth."""
_LOUDER = 1.2
_AS_LOUD, _SLIGHT = 1.15, 0.4
"""Floors are known to so much, in variance; the pole of a slight colour."""
_UNSEEN = 1.5, _STRICTLY_FRESH
"""The first where rows hide any colour, and the correlation that what is new has less of: at 50 Hz filtered noise was
1.4 times its floor, and a spring behind a tuning `unknown`."""


def noise_behind(
    shooting: Shooting, fit: Fit, floor: NoiseModel | None = None, last: bool = False
) -> NoiseModel | None:
    """Level and colour of what a fit leaves, for the channels where that is clearly not what the noise model says.

    A floor without a model cannot tell a filter's noise from a fast motion: under a tight loop that moves at 10 Hz,
    recorded at 100 Hz, it was ten times too high in variance, and hid what was weak. What any model leaves bounds the
    noise from above. Where it is no noise of any colour, and half of what was thought or less, the closest colour
    stands in: what was hidden shows, and the noise is looked at again behind it.

    Nor can a floor see a filter in recordings that are slow, short or uneven, or miss rows. What is left may be
    physics, so noise is louder than the floor in one case alone: there, what is new in what is left is white, and so
    loud that high differences would show just that floor. Elsewhere that must be so strictly, and behind names.

    Args:
        shooting: the likelihood.
        fit: the best set.
        floor: the noise without a model; that of the likelihood where it was not changed.
        last: whether nobody would look behind it again; then nothing stands in.

    Returns:
        The noise, or None where it stays as it is in all channels.
    """
    old = shooting.noise
    scale, colour = old.scale.copy(), old.colour.copy()
    found = False
    for channel, left in enumerate(_left(shooting, fit)):
        own, first = _of(old, channel), _of(floor or old, channel)
        new = _quieter(left, own, first, last)
        if new is None and hides_filters(shooting.segments.runs, channel):
            new = _filtered(left, own, first)
            if new is None and moves_quickly(shooting.segments.runs, channel):
                new = _filtered(left, own, first, moves=True)
        if new is None and fit.effects:
            new = _surely_filtered(left, own, first)
        if new is not None:
            found = True
            scale[channel], colour[channel] = np.sqrt(new[1]) / colour_scale(new[0]), new[0]
    return NoiseModel(scale, colour) if found else None


def recoloured(shooting: Shooting, fit: Fit) -> NoiseModel:
    """The noise with the colour of what a fit leaves, in channels where that is white noise but for a slight colour.

    A quantised encoder behind a filter leaves neither white noise nor that of any filter, and differences see little of
    its colour. To a force that is free in time it looked like a fifth of a weak mismatch.

    Args:
        shooting: the likelihood.
        fit: the best set.
    """
    noise = shooting.noise
    scale, colour = noise.scale.copy(), noise.colour.copy()
    for channel, left in enumerate(_left(shooting, fit)):
        thought, poles = _of(noise, channel), left.colour()
        new, before = left.innovation(poles), left.innovation(thought.poles) / thought.innovation
        slight = not any(thought.poles) and 0.0 < poles[0] <= _SLIGHT and poles[1] == 0.0
        bar, fresh = (_AS_LOUD, _FRESH) if before < _AS_LOUD or not shooting.hides_colour else _UNSEEN
        if slight and before < bar and left.is_white_behind(poles, fresh):
            scale[channel], colour[channel] = np.sqrt(new) / colour_scale(poles), poles
    return dataclasses.replace(noise, scale=scale, colour=colour)


def rises(shooting: Shooting, fit: Fit) -> bool:
    """Whether what a fit leaves in some channel is louder at some frequency than at lower ones, as no filter leaves it.

    Noise that an encoder or a recorder filtered falls with the frequency, whatever the filter.

    Args:
        shooting: the likelihood.
        fit: of a set.
    """
    asked = ((left, lags) for left in _left(shooting, fit) for lags in {left.lags(far) for far in _FAR})
    return any(left.rise(lags) > max(_RISES, _CHANCE_RISE * np.sqrt(lags / left.count)) for left, lags in asked)


def by_segment(shooting: Shooting, fit: Fit) -> tuple[Array, NDArray[np.int64]]:
    """The sum of squares of what is new in each segment, ``(C, S)``, and of how many values, ``(S,)``.

    In units of the noise, behind the likeliest colour of what is left. Noise of any level and colour leaves about as
    much for each value in all segments.

    Args:
        shooting: the likelihood.
        fit: of a set.
    """
    lefts = _left(shooting, fit)
    if not lefts:
        return np.zeros((0, shooting.segments.size)), np.zeros(shooting.segments.size, dtype=np.int64)
    scales = shooting.noise.innovation
    powers = [((left.fresh(left.colour()) / s) ** 2).sum(axis=1) for left, s in zip(lefts, scales, strict=True)]
    return np.array(powers), lefts[0].counts


def raised(floor: NoiseModel, noise: NoiseModel) -> NoiseModel:
    """A floor where another noise is louder: that."""
    louder = noise.innovation > floor.innovation
    return NoiseModel(np.where(louder, noise.scale, floor.scale), np.where(louder[:, None], noise.colour, floor.colour))


class _Noise(NamedTuple):
    """That of one channel: its colour, and the variance of what is new."""

    poles: tuple[float, float]
    innovation: float


def _of(noise: NoiseModel, channel: int) -> _Noise:
    first, second = noise.colour[channel]
    return _Noise((float(first), float(second)), float(noise.innovation[channel] ** 2))


def _quieter(left: _Left, thought: _Noise, floor: _Noise, last: bool) -> _Noise | None:
    """The noise of a channel where what is left is less than was thought, and no louder than its floor."""
    poles = left.colour()
    new, before = left.innovation(poles), left.innovation(thought.poles) / thought.innovation
    if is_white([*left.fresh(poles)]):
        gained = left.count * (np.log(thought.innovation / new) + before - 1.0)
        under = left.innovation(floor.poles) <= floor.innovation
        fits = under and (thought.innovation < floor.innovation or (before <= 1.0 and new < _LESS * thought.innovation))
        better = fits and not _LESS < new / thought.innovation < 1.0 / _LESS and gained > SEEN
    else:
        better = not last and new < _STANDS_IN * thought.innovation
    return _Noise(poles, new) if better else None


def _filtered(left: _Left, thought: _Noise, floor: _Noise, moves: bool = False) -> _Noise | None:
    """The noise of a channel where a filter hides most of it from a floor that took it for white.

    Where the motion goes on to the end of the spectrum, high differences see more than the noise: what is new must be
    the whiter, and need be no louder if what is slow is; a slight colour is no filter there.
    """
    poles = left.colour()
    new = left.innovation(poles)
    slow = new / (1.0 - sum(poles)) ** 2 if moves else new
    known, slight = any(floor.poles) or any(thought.poles), poles[0] <= (_SLIGHT if moves else 0.0)
    if known or slight or slow < _LOUDER * thought.innovation:
        return None
    noise = _Noise(poles, new)
    high, fresh = (_LESS_HIGH, _STRICTLY_FRESH) if moves else (_SAME_HIGH, _FRESH)
    return noise if _shows_the_floor(left, noise, floor, high, fresh) else None


def _surely_filtered(left: _Left, thought: _Noise, floor: _Noise) -> _Noise | None:
    """The noise of a channel where what is left is a filter's and nothing else, whatever a spectrum showed."""
    poles = left.colour()
    noise = _Noise(poles, left.innovation(poles))
    quick = 0.0 < poles[0] <= _SLOWEST and poles[1] == 0.0
    louder = noise.innovation > _LOUDER * thought.innovation
    surely = quick and louder and _shows_the_floor(left, noise, floor, _STRICTLY_HIGH, _STRICTLY_FRESH)
    return noise if surely else None


def _shows_the_floor(left: _Left, noise: _Noise, floor: _Noise, high: tuple[float, float], fresh: float) -> bool:
    """Whether what is new is white to `fresh`, and high differences see the floor's variance in it, times `high`."""
    shown = noise.innovation * high_differences(noise.poles) / (floor.innovation * high_differences(floor.poles))
    return high[0] < shown < high[1] and left.is_white_behind(noise.poles, fresh)


def _left(shooting: Shooting, fit: Fit) -> list[_Left]:
    """What is left of each channel; none where too little is known of it."""
    predicted = shooting.engine.predict(shooting.segments, fit.starts[None], [fit.candidate])
    residual, counts = shooting.measured - predicted[0], shooting.segments.counts
    usable = np.asarray(counts[:, 2:] & counts[:, 1:-1] & counts[:, :-2])
    if usable.sum() < _LEAST or not np.isfinite(residual[counts]).all():
        return []
    least = np.minimum(shooting.noise.innovation, finest(shooting.segments.runs)) ** 2
    freed = shooting.dof / max(shooting.samples, 1)
    return [_Left(residual[..., c], usable, freed, float(each)) for c, each in enumerate(least)]


class _Left:
    """What is left of one channel.

    Args:
        series: ``(S, K + 1)``.
        usable: where a value and the two before it count, ``(S, K - 1)``.
        freed: degrees of freedom over samples.
        least: variance of what is new, at least.
    """

    def __init__(self, series: Array, usable: NDArray[np.bool_], freed: float, least: float) -> None:
        self._series, self._usable, self._freed, self._least = series, usable, freed, least

    @property
    def count(self) -> int:
        """How many values follow two others."""
        return int(self.counts.sum())

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many in each segment, ``(S,)``."""
        return np.asarray(self._usable.sum(axis=1))

    def colour(self) -> tuple[float, float]:
        """The likeliest colour."""
        return likeliest(self.innovation, self.count)

    def fresh(self, poles: tuple[float, float]) -> Array:
        """What is new in each value, zero where it is not known, ``(S, K - 1)``."""
        fresh = self._series[:, 2:] - poles[0] * self._series[:, 1:-1] - poles[1] * self._series[:, :-2]
        return np.where(self._usable, fresh, 0.0)

    def innovation(self, poles: tuple[float, float]) -> float:
        """Variance of what is new."""
        return max(float((self.fresh(poles) ** 2).sum() / self._usable.sum()) / self._freed, self._least, 1e-300)

    def lags(self, most: int) -> int:
        """How far an autocovariance is asked for, at most."""
        return int(min(most, self._series.shape[1] // 2))

    def rise(self, lags: int) -> float:
        """Logarithm of the most by which it is louder at some frequency than in the mean of all that are clearly lower.

        By its autocovariances up to so many rows apart under a window (Blackman and Tukey); not counting what initial
        states absorb.
        """
        known = np.zeros(self._series.shape, dtype=bool)
        for late in range(3):
            known[:, late : late + self._usable.shape[1]] |= self._usable
        series, rows = np.where(known, self._series, 0.0), self._series.shape[1]
        each = np.arange(lags + 1)
        pairs = [(known[:, k:] & known[:, : rows - k]).sum() for k in each]
        level = [(series[:, k:] * series[:, : rows - k]).sum() / max(n, 1) for k, n in zip(each, pairs, strict=True)]
        window = np.where(each > 0, 1.0, 0.5) * (1.0 + np.cos(np.pi * each / lags))
        frequency = np.linspace(0.0, 0.5, 5 * len(each))
        power = (window * level) @ np.cos(2.0 * np.pi * np.outer(each, frequency))
        told = np.log(np.maximum(power, _LITTLE * power.max()))[frequency > _ABSORBED / rows]
        lower = np.cumsum(told) / np.arange(1, len(told) + 1)
        return float((told[_APART:] - lower[:-_APART]).max())

    def is_white_behind(self, poles: tuple[float, float], least: float = _FRESH) -> bool:
        """Whether what is new is white, strictly: no correlation beyond so much, or chance."""
        return is_white([*self.fresh(poles)], max(least, _CHANCE / np.sqrt(self.count)), _LAGS)
