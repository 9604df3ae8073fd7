"""Axes: a range of values, its place on paper, and round tick marks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from torch_activegp.report.numbers import minus, number

EXTENT = 1000.0
_FAR = 3.0 * EXTENT


@dataclass(frozen=True)
class Axis:
    """One axis of a chart.

    Args:
        label: what it shows, with the unit in brackets.
        low: value at its start.
        high: value at its end.
        log: whether it is logarithmic.
        wanted: number of tick marks, about.
    """

    label: str
    low: float
    high: float
    log: bool = False
    wanted: int = 5

    def place(self, values: ArrayLike) -> np.ndarray:
        """Values to positions from 0 to 1000; far ones are kept near enough to be drawn, NaN stays."""
        array = np.asarray(values, dtype=float)
        if self.log:
            array = np.log(np.maximum(array, self.low))
            low, high = math.log(self.low), math.log(self.high)
        else:
            low, high = self.low, self.high
        return np.clip(EXTENT * (array - low) / (high - low), -_FAR, _FAR)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Place in per cent and text of each tick mark."""
        values = _log_ticks(self.low, self.high) if self.log else []
        texts = [number(value) for value in values]
        if not values:
            step = _round_step((self.high - self.low) / self.wanted)
            first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
            values = [index * step for index in range(first, last + 1)]
            texts = _even_texts(values, step)
        return list(zip((np.round(self.place(values) / EXTENT * 100, 2)).tolist(), texts, strict=True))


def axis_over(label: str, *values: ArrayLike, log: bool = False, margin: float = 0.05) -> Axis:
    """An axis that holds all finite values, with a margin as a share of their range."""
    found = np.concatenate([np.asarray(part, dtype=float).ravel() for part in values] or [np.zeros(0)])
    found = found[np.isfinite(found) & ((found > 0) | (not log))]
    if not found.size:
        return Axis(label, 0.1, 10.0, log) if log else Axis(label, -1.0, 1.0)
    low, high = float(found.min()), float(found.max())
    if log:
        stretch = (high / low) ** margin if high > low else 2.0
        return Axis(label, low / stretch, high * stretch, log=True)
    room = margin * (high - low) or 0.0
    if not high - low > 1e-9 * max(abs(low), abs(high)):
        room = max(abs(high), 1.0) * 0.5
    return Axis(label, low - room, high + room)


def _round_step(step: float) -> float:
    power = 10.0 ** math.floor(math.log10(step))
    return next(factor * power for factor in (1, 2, 2.5, 5, 10) if factor * power >= 0.9 * step)


def _log_ticks(low: float, high: float) -> list[float]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    every = max(1, (last - first) // 5)
    for factors in ((1.0,), (1.0, 3.0), (1.0, 2.0, 5.0)):
        powers = range(first, last + 1, every if len(factors) == 1 else 1)
        values = [factor * 10.0**power for power in powers for factor in factors]
        values = [value for value in values if low <= value * (1 + 1e-9) and value <= high * (1 + 1e-9)]
        if len(values) >= 3:
            return values
    return []


def _even_texts(values: list[float], step: float) -> list[str]:
    largest = max(map(abs, values), default=0.0)
    if largest >= 1e5 or step < 1e-4:
        return [number(value) for value in values]
    decimals = next(n for n in range(6) if abs(step - round(step, n)) < 1e-6 * step)
    return [minus(f"{value + 0.0:.{decimals}f}") if value else "0" for value in values]
