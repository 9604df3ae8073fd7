"""Charts as inline SVG that stretches with the page while its text keeps its size.

A chart is plain values; ``templates/chart.html`` draws it. All colours come from the style sheet, so one chart serves
the light page, the dark page and paper.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from torch_activegp.report.axis import EXTENT, Axis

_MOST_POINTS = 1200
_MOST_DOTS = 1500


@dataclass(frozen=True)
class Mark:
    """Something drawn in a chart.

    Args:
        look: class in the style sheet: ``measured``, ``before``, ``after``, ``gp``, ``noise``, ``dots``, ...
        path: SVG path data in the chart's square of 1000 by 1000.
        label: entry in the legend; none if empty.
        readable: whether a pointer on the chart reads its values.
    """

    look: str
    path: str
    label: str = ""
    readable: bool = False


@dataclass(frozen=True)
class Chart:
    """Marks between two axes, with a title that says the finding."""

    title: str
    x: Axis
    y: Axis
    marks: Sequence[Mark]
    note: str = ""
    size: str = ""

    @property
    def description(self) -> str:
        """What a screen reader says instead of the picture."""
        labels = [mark.label for mark in self.marks if mark.label]
        return f"{self.title}. {self.y.label} over {self.x.label}: {', '.join(labels)}."


def line(look: str, x: Axis, y: Axis, points: tuple[ArrayLike, ArrayLike], label: str = "") -> Mark:
    """A line through points; it breaks at NaN, and keeps its peaks where points are left out."""
    horizontal, vertical = _thinned(_numbers(points[0]), _numbers(points[1]))
    return Mark(look, _path(x.place(horizontal), _up(y.place(vertical))), label, readable=True)


def steps(look: str, x: Axis, y: Axis, bins: tuple[ArrayLike, ArrayLike], label: str = "") -> Mark:
    """A line that keeps its height within each bin: edges (n + 1) and heights (n)."""
    edges, heights = _numbers(bins[0]), _numbers(bins[1])
    horizontal, vertical = np.repeat(edges, 2)[1:-1], np.repeat(heights, 2)
    return Mark(look, _path(x.place(horizontal), _up(y.place(vertical))), label, readable=True)


def band(look: str, y: Axis, ends: tuple[float, float], label: str = "") -> Mark:
    """A band between two heights, over the whole width."""
    low, high = _up(y.place(np.array(ends)))
    return Mark(look, f"M0 {low:.1f}H{EXTENT:.0f}V{high:.1f}H0Z", label)


def level(look: str, y: Axis, height: float, label: str = "") -> Mark:
    """A line at one height, over the whole width."""
    return Mark(look, f"M0 {_up(y.place(height)):.1f}H{EXTENT:.0f}", label)


def dots(look: str, x: Axis, y: Axis, points: tuple[ArrayLike, ArrayLike], label: str = "") -> Mark:
    """A dot for each point, evenly thinned where there are very many."""
    horizontal, vertical = _few(*map(_numbers, points))
    places = _inside(x.place(horizontal), _up(y.place(vertical)))
    return Mark(look, "".join(f"M{a:.1f} {b:.1f}h.01" for a, b in places), label)


def whiskers(look: str, x: Axis, y: Axis, points: tuple[ArrayLike, ArrayLike, ArrayLike], label: str = "") -> Mark:
    """A vertical line for each point: position, lower and upper end."""
    horizontal, low, high = _few(*map(_numbers, points))
    ends = zip(x.place(horizontal), _up(y.place(low)), _up(y.place(high)), strict=True)
    drawn = (f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in ends if np.isfinite((a, b, c)).all())
    return Mark(look, "".join(drawn), label)


def _numbers(values: ArrayLike) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    return np.where(np.isinf(array), np.sign(array) * 1e30, array)


def _up(places: np.ndarray) -> np.ndarray:
    return EXTENT - places


def _path(horizontal: np.ndarray, vertical: np.ndarray) -> str:
    parts, pen = [], "M"
    for a, b in zip(horizontal.tolist(), vertical.tolist(), strict=True):
        if np.isnan(a) or np.isnan(b):
            pen = "M"
            continue
        parts.append(f"{pen}{a:.1f} {b:.1f}")
        pen = "L"
    return "".join(parts)


def _inside(horizontal: np.ndarray, vertical: np.ndarray) -> Iterable[tuple[float, float]]:
    pairs = zip(horizontal.tolist(), vertical.tolist(), strict=True)
    return (pair for pair in pairs if all(-1 <= place <= EXTENT + 1 for place in pair))


def _few(*columns: np.ndarray) -> list[np.ndarray]:
    every = -(-len(columns[0]) // _MOST_DOTS) or 1
    return [column[::every] for column in columns]


def _thinned(horizontal: np.ndarray, vertical: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest point of each of many short pieces."""
    if len(vertical) <= _MOST_POINTS:
        return horizontal, vertical
    keep = {0, len(vertical) - 1}
    for piece in np.array_split(np.arange(len(vertical)), _MOST_POINTS // 2):
        part = vertical[piece]
        keep |= {int(piece[np.argmin(np.nan_to_num(part, nan=np.inf))])}
        keep |= {int(piece[np.argmax(np.nan_to_num(part, nan=-np.inf))])}
    index = sorted(keep)
    return horizontal[index], vertical[index]
