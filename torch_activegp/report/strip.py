"""Strips: one row of coloured cells along time, dark where the simulator is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from torch_activegp.report.axis import EXTENT, Axis
from torch_activegp.report.numbers import number

BOUNDS = (1.3, 2.0, 4.0, 10.0, 30.0, 100.0)
"""Chi2 per degree of freedom at which a cell takes the next colour; 1 is noise alone."""
_MOST_CELLS = 80


@dataclass(frozen=True)
class Cell:
    """One cell: start and width of 1000, its colour level, and the text that a pointer shows."""

    start: float
    width: float
    level: int
    text: str


def cells(axis: Axis, centres: Sequence[Any], values: Sequence[Any]) -> list[Cell]:
    """Cells around the centres of segments; many short ones are joined and take the largest value.

    Args:
        axis: over time [s].
        centres: time of each segment's centre, s.
        values: chi2 per degree of freedom.
    """
    where, what = np.asarray(centres, dtype=float), np.asarray(values, dtype=float)
    known = np.isfinite(where) & ~np.isnan(what)
    where, what = where[known], what[known]
    if not where.size:
        return []
    half = float(np.median(np.diff(where))) / 2 if where.size > 1 else (axis.high - axis.low) / 2
    pieces = np.array_split(np.arange(where.size), min(where.size, _MOST_CELLS))
    found = []
    for piece in pieces:
        ends = np.array([where[piece[0]] - half, where[piece[-1]] + half])
        left, right = np.clip(axis.place(ends), 0, EXTENT)
        value = float(what[piece].max())
        text = f"{number(float(where[piece].mean()))} s: {number(value, 2)}"
        found.append(Cell(round(float(left), 1), round(float(right - left), 1), level_of(value), text))
    return found


def level_of(value: float) -> int:
    """Colour level of a value: 0 for noise, up to 6."""
    return sum(value >= bound for bound in BOUNDS)


def legend() -> list[tuple[int, str]]:
    """Level and text of each colour."""
    texts = [f"under {number(BOUNDS[0])}", *(number(low) for low in BOUNDS)]
    pairs = pairwise(texts[1:])
    middle = [f"{low}\u2013{high}" for low, high in pairs]
    return list(enumerate([texts[0], *middle, f"over {texts[-1]}"]))
