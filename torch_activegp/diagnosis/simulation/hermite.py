"""Cubic Hermite interpolation: between two positions and their velocities."""

from __future__ import annotations

import itertools

from torch_activegp.diagnosis.inputs.runs import Array


def position_between(x: Array, h: Array | float, p: Array, q: Array, v: Array, w: Array) -> Array:
    """Position at a share x of an interval.

    Args:
        x: 0 at the beginning, 1 at the end.
        h: length of the interval, s.
        p: position at the beginning, rad or m.
        q: position at the end.
        v: velocity at the beginning, rad/s or m/s.
        w: velocity at the end.
    """
    return (1 + 2 * x) * (1 - x) ** 2 * p + x * (1 - x) ** 2 * h * v + x**2 * (3 - 2 * x) * q + x**2 * (x - 1) * h * w


def velocity_between(x: Array, h: Array | float, p: Array, q: Array, v: Array, w: Array) -> Array:
    """Velocity at a share x of an interval; see :func:`position_between`."""
    return 6 * x * (1 - x) * (q - p) / h + (1 - x) * (1 - 3 * x) * v + x * (3 * x - 2) * w


def fill_rows(states: Array, edges: list[int], dt: Array, nq: int) -> None:
    """Fills rows between time steps by cubic Hermite interpolation, in place."""
    for row, after in itertools.pairwise(edges):
        begin, end = states[:, row], states[:, after]
        h = dt[:, row:after].sum(axis=1)[:, None]
        for between in range(row + 1, after):
            x = dt[:, row:between].sum(axis=1)[:, None] / h
            ends = begin[:, :nq], end[:, :nq], begin[:, nq:], end[:, nq:]
            states[:, between, :nq] = position_between(x, h, *ends)
            states[:, between, nq:] = velocity_between(x, h, *ends)
