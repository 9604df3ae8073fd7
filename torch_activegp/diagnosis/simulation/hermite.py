"""Cubic Hermite interpolation: between two positions and their velocities."""

from __future__ import annotations

import numpy as np

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
    """Fills rows between time steps by cubic Hermite interpolation, in place.

    Args:
        states: ``(R, K + 1, nq + nv)``, known at the edges.
        edges: rows at which time steps begin and end, E + 1 of them.
        dt: between rows, ``(R, K)``, s.
        nq: number of positions.
    """
    begin, end = np.asarray(edges[:-1]), np.asarray(edges[1:])
    time = np.pad(np.cumsum(dt, axis=1), ((0, 0), (1, 0)))[..., None]
    for ahead in range(1, int((end - begin).max())):
        inside = begin + ahead < end
        first, last = begin[inside], end[inside]
        row, h = first + ahead, time[:, last] - time[:, first]
        x, one, other = (time[:, row] - time[:, first]) / h, states[:, first], states[:, last]
        ends = one[..., :nq], other[..., :nq], one[..., nq:], other[..., nq:]
        states[:, row, :nq] = position_between(x, h, *ends)
        states[:, row, nq:] = velocity_between(x, h, *ends)
