"""Noise behind a steep low-pass filter: level up to its corner, and next to nothing above."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter

_ORDERS = ((2, 1), (3, 1), (4, 1), (1, 2), (2, 2), (3, 2), (4, 2))
"""Orders of Butterworth filters, and how often they are run: twice where forth and back."""
_CORNERS = np.geomspace(0.01, 0.35, 80)
LOWEST = 9.0
"""Corners below this, Hz, are not sought: what is level up to there may be a servo that follows its reference."""
_LEVEL = 5
"""Bins that must be level, below the corner."""
_BELOW = 0.7
"""Part of the corner up to which the filter lets nearly all pass."""
_CLOSE = 0.17
"""Root mean square of the decimal logarithm by which a spectrum may be off: 0.06 to 0.12 behind filters, 0.15 of
five runs of 6 s at 100 Hz, and 0.2 to 0.5 where motion is in the lowest bins."""
_AS_CLOSE_AS_KNOWN = 0.25
"""The same of a filter as another joint showed it: 0.17 to 0.22 where five short runs at 100 Hz told its corner as 0.9
of what it is. Fitted anew, corner and level hide each other."""
_BENDS = 0.5
"""Part of a straight line's misfit that such a filter may leave: motion falls with a power of the frequency."""
_AS_LOUD = 30.0
"""Times the noise of the other joint, or a part of it, that it may be; one may be in m and one in rad."""
_AS_MOTION = 2
"""Poles of filters that fall as motion does, with the fourth power."""
_SLOPE = 1.0
"""Power of the frequency with which the level part may fall; motion falls with the fourth."""
_DEEP, _DEEP_TO_WHITE = 2.0, 1.0
"""Decades by which the noise must fall from there to the end; and to white noise that was added behind the filter."""
_NO_LOUDER, _STEEP = 0.5, 6.0
"""Decimal logarithm by which a spectrum may be above the noise behind a filter to be that, for it is below where the
order was judged too low, and 1.7 to 2.1 above of motion; and the power of the frequency with which it must fall, where
motion falls with the fourth."""
_ABOVE_REST = 10.0
"""Times what is left at the end of the spectrum (rounding, leaks of the window) up to which a bin says nothing."""


def shelf(
    frequency: Array, power: Array, lowest: float = 0.0, deepest: float = np.inf, white: float = 0.0
) -> SteepFilter | None:
    """The level of noise that a Butterworth filter of any order has passed, forth or forth and back.

    Positions that were filtered after they were recorded have noise that differences hardly see, and that falls more
    steeply than one or two poles make it. What tells it from motion is that it is level first, for motion falls with
    the fourth power of the frequency wherever forces are level: noise of 0.7 mrad behind 30 Hz, forth and back, at 250
    Hz, was taken for 0.03 mrad, and the motion for a mismatch of 776 times the noise.

    Args:
        frequency: of some bins, in parts of the sampling rate, rising, ``(F,)``.
        power: one-sided density at unit sampling rate, ``(F,)``.
        lowest: corner that is sought, in parts of the sampling rate.
        deepest: decades below the level that are looked at; in short windows what is less leaks from bins near by.
        white: density of noise that was added behind the filter, as a coarse encoder adds it.

    Returns:
        The shelf that goes on down to the lowest frequency; None where there is none, or none that is seen: at least
        five bins must be level below 0.7 of its corner.
    """
    end = _told(power) if np.isinf(deepest) else len(power)
    if white > 0.0:
        power, end = power - white, _before(power < 2.0 * white)
    deep = _DEEP_TO_WHITE if white > 0.0 else _DEEP
    filters = [*itertools.product(_ORDERS, _CORNERS[_CORNERS >= lowest])]
    passed = np.array([np.log10(_passed(frequency[:end], *one)) for one in filters])
    for first in range(max(end - 2 * _LEVEL, 0)):
        p = np.log10(power[first:end])
        p = p[: _before(p < np.median(p[:_LEVEL]) - deepest)]
        if len(p) < 2 * _LEVEL:
            continue
        f, apart = frequency[first : first + len(p)], p - passed[:, first : first + len(p)]
        misfits = apart.std(axis=1)
        best = int(np.argmin(misfits))
        order, corner = filters[best]
        level = float(apart[best].mean())
        if misfits[best] < _CLOSE and _is_level(f, apart[best], corner) and p.min() < level - deep:
            found = _shelf(order, float(corner), level)
            return found._replace(scale=float(np.hypot(found.scale, np.sqrt(0.5 * white))))
    return None


def shelf_behind(frequency: Array, power: Array, known: SteepFilter) -> SteepFilter | None:
    """The level of noise behind a filter that is known, from a sibling's channel, where motion hides that it is level.

    A joint that moves up to the corner of its filter leaves nothing level to see it by. Joints are filtered alike; if
    so, the spectrum is that filter's from where the motion ends, and bends where its corner is. A filter of two poles
    falls as motion does, and is not sought so.

    Args:
        frequency: of some bins, in parts of the sampling rate, rising, ``(F,)``.
        power: one-sided density at unit sampling rate, ``(F,)``.
        known: the filter of another joint.

    Returns:
        The same filter with the level of this noise. None where ten bins or fewer, from 0.7 of the corner or below, or
        less than two decades, are like it, or a straight line is nearly as close; or it would be 30 times as loud.
    """
    times, often = known.order
    if times * often <= _AS_MOTION:
        return None
    end = _told(power)
    told, levels = np.log10(frequency[:end]), np.log10(power[:end])
    apart = levels - np.log10(_passed(frequency[:end], known.order, known.corner))
    for first in range(min(int((frequency < _BELOW * known.corner).sum()), end - 2 * _LEVEL)):
        rest, tail = apart[first:], levels[first:]
        straight = tail - np.polyval(np.polyfit(told[first:], tail, 1), told[first:])
        bends = rest.std() < min(_AS_CLOSE_AS_KNOWN, _BENDS * straight.std())
        if bends and tail.max() - tail.min() > _DEEP:
            found = _shelf(known.order, known.corner, float(rest.mean()))
            return found if 1.0 / _AS_LOUD < found.scale / known.scale < _AS_LOUD else None
    return None


def shelf_beside(frequency: Array, power: Array, sibling: Array, known: SteepFilter) -> SteepFilter | None:
    """The level of noise behind the filter of another joint whose spectrum is in proportion at the end.

    Joints are filtered alike, whatever the filter; where their motion has ended, their noises differ by a factor alone.
    Noise of 0.39 mrad on a double pendulum at 100 Hz, behind 12 Hz, was told by one joint, and taken for 0.01 mrad at
    the other, that moved up to 20 Hz: what a simulator without any fault left was 3200 times that.

    Motions of coupled joints are in proportion too. So the other joint's spectrum must be no louder there than its
    noise, and fall more steeply than motion does.

    Args:
        frequency: of some bins, in parts of the sampling rate, rising, ``(F,)``.
        power: one-sided density at unit sampling rate, ``(F,)``.
        sibling: that of the other joint, ``(F,)``.
        known: its filter, whose order may be misjudged.

    Returns:
        The same filter with the level of this noise. None where fewer than ten bins of the upper half beyond the corner
        say anything, those of the other joint are motion, the two are not in proportion, or it would be 30 times as
        loud.
    """
    end = min(_told(power), _told(sibling))
    first = end - int((frequency[:end] > known.corner).sum()) // 2
    if end - first < 2 * _LEVEL:
        return None
    f, told = frequency[first:end], np.log10(sibling[first:end])
    expected = np.log10(_passed(f, known.order, known.corner)) + _level(known)
    falls = -np.polyfit(np.log10(f), told, 1)[0]
    apart = np.log10(power[first:end]) - told
    louder = float(10.0 ** (0.5 * apart.mean()))
    is_noise = (told - expected).mean() < _NO_LOUDER and falls > _STEEP
    if not (is_noise and apart.std() < _CLOSE and 1.0 / _AS_LOUD < louder < _AS_LOUD):
        return None
    return known._replace(scale=louder * known.scale)


def _told(power: Array) -> int:
    """Bins before the first that says nothing."""
    return _before(power <= _ABOVE_REST * power[-_LEVEL:].mean())


def _before(ends: NDArray[np.bool_]) -> int:
    """How many there are before the first that is true."""
    return int(np.argmax(ends)) if ends.any() else len(ends)


def _shelf(order: tuple[int, int], corner: float, level: float) -> SteepFilter:
    """The shelf of a level, as the decimal logarithm of a density."""
    return SteepFilter(corner, float(np.sqrt(0.5 * 10.0**level * _part(order, corner))), order)


def _level(known: SteepFilter) -> float:
    """The inverse of that: the level of a filter's noise."""
    return float(np.log10(2.0 * known.scale**2 / _part(known.order, known.corner)))


def _part(order: tuple[int, int], corner: float) -> float:
    """Part of the power of white noise that a filter passes."""
    return float(np.mean(_passed(np.linspace(0.0, 0.5, 513)[1:-1], order, corner)))


def _passed(f: Array, order: tuple[int, int], corner: float) -> Array:
    """Part of the power that a digital filter passes."""
    times, often = order
    return np.asarray((1.0 + (np.tan(np.pi * f) / np.tan(np.pi * corner)) ** (2 * times)) ** -often)


def _is_level(f: Array, apart: Array, corner: float) -> bool:
    """Whether what the filter does not make of a spectrum, as its decimal logarithm, is level below the corner."""
    below = f < _BELOW * corner
    if below.sum() < _LEVEL:
        return False
    return bool(abs(np.polyfit(np.log10(f[below]), apart[below], 1)[0]) < _SLOPE)
