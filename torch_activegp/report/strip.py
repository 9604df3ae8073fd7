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


def cells(
    axis: Axis, centres: Sequence[Any], values: Sequence[Any], lengths: Sequence[Any] | None = None
) -> list[Cell]:
    """Cells around the centres of segments; many short ones are joined and take the largest value.

    Args:
        axis: over time [s].
        centres: time of each segment's centre, s.
        values: chi2 per degree of freedom.
        lengths: of each segment, s; without them they lie side by side.
    """
    where, what = np.asarray(centres, dtype=float), np.asarray(values, dtype=float)
    known = np.isfinite(where)
    if not known.any():
        return []
    long = None if lengths is None else np.asarray(lengths, dtype=float)[known]
    where, what = where[known], what[known]
    alone = long is None and where.size == 1
    left, right = (np.array([axis.low]), np.array([axis.high])) if alone else spans(where, long)
    pieces = np.array_split(np.arange(where.size), min(where.size, _MOST_CELLS))
    found = []
    for piece in pieces:
        if np.isnan(what[piece]).all():
            continue
        ends = np.array([left[piece[0]], right[piece[-1]]])
        begin, end = np.clip(axis.place(ends), 0, EXTENT)
        value = float(np.nanmax(what[piece]))
        text = f"{number(float(where[piece].mean()))} s: {number(value, 2)}"
        found.append(Cell(round(float(begin), 1), round(float(end - begin), 1), level_of(value), text))
    return found


def spans(centres: np.ndarray, lengths: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Begin and end of each segment, s; of unknown lengths they lie side by side, and meet midway between centres.

    Args:
        centres: time of each segment's centre, ``(S,)``, s.
        lengths: of each, ``(S,)``, s.
    """
    if lengths is not None:
        return centres - lengths / 2, centres + lengths / 2
    if centres.size < 2:
        return centres - 0.5, centres + 0.5
    middle = (centres[1:] + centres[:-1]) / 2
    first, last = 2 * centres[0] - middle[0], 2 * centres[-1] - middle[-1]
    return np.concatenate([[first], middle]), np.concatenate([middle, [last]])


def level_of(value: float) -> int:
    """Colour level of a value: 0 for noise, up to 6."""
    return sum(value >= bound for bound in BOUNDS)


def legend() -> list[tuple[int, str]]:
    """Level and text of each colour."""
    texts = [f"under {number(BOUNDS[0])}", *(number(low) for low in BOUNDS)]
    pairs = pairwise(texts[1:])
    middle = [f"{low}\u2013{high}" for low, high in pairs]
    return list(enumerate([texts[0], *middle, f"over {texts[-1]}"]))
