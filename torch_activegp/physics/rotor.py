"""A rotor between the ends of a gap, carried along the recorded motion of its joint."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Motion(NamedTuple):
    """A joint at B + 1 rows of n recordings, ``(n, B + 1)`` each, in units of the joint."""

    position: Array
    velocity: Array
    acceleration: Array

    @classmethod
    def along(cls, positions: Array, dt: float, span: int) -> Motion:
        """From smoothed positions ``(n, T)`` on an even clock; differences over so many rows on either side."""
        edges = ((0, 0), (span, span))
        if positions.shape[1] <= 2 * span:
            return cls(positions, np.zeros_like(positions), np.zeros_like(positions))
        before, after = positions[:, : -2 * span], positions[:, 2 * span :]
        bent = (before + after - 2.0 * positions[:, span:-span]) / (span * dt) ** 2
        return cls(positions, np.gradient(positions, dt, axis=1), np.pad(bent, edges, mode="edge"))

    def at(self, run: NDArray[Any], rows: NDArray[Any]) -> Motion:
        """In some rows ``(n, B + 1)`` of some runs ``(n,)``; at the ends of a run where there is no such row."""
        rows = np.clip(rows, 0, self.position.shape[1] - 1)
        return Motion(*(each[run[:, None], rows] for each in self))


def carried(
    motion: Motion, torque: Array, begun: NDArray[np.bool_], dt: float, inertia: float, half: Array, parts: int
) -> tuple[Array, Array, Array]:
    """Where a rotor is in the end: against its joint, how fast against it, and on which side it touches, ``(n,)`` each.

    It begins on the side on which it must push to keep up with the joint. From there on it flies freely, or moves with
    the joint as long as it would not have to pull; where it touches it stays. So each touch makes good what was wrong
    until then.

    Args:
        motion: of the joint at B + 1 rows.
        torque: on the rotor between them, ``(n, B)``, N m or N.
        begun: whether the recording had begun, ``(n, B)``.
        dt: time between rows, s.
        inertia: of the rotor, kg m2 or kg.
        half: half the gap, ``(n,)``, rad or m.
        parts: time steps between two rows.
    """
    step = dt / parts
    first = begun.argmax(axis=1)[:, None]
    needed = inertia * np.take_along_axis(motion.acceleration, first, axis=1)[:, 0]
    side = np.where(np.take_along_axis(torque, first, axis=1)[:, 0] < needed, -1.0, 1.0)
    place, speed = side * half, np.zeros_like(half)
    for k, part in np.ndindex(torque.shape[1], parts):
        x = part / parts
        position, velocity, acceleration = ((1.0 - x) * each[:, k] + x * each[:, k + 1] for each in motion)
        push = torque[:, k]
        held = (side != 0.0) & (side * (push - inertia * acceleration) >= 0.0)
        fast = np.where(held, 0.0, np.where(side != 0.0, 0.0, speed))
        there = (1.0 - x - 1.0 / parts) * motion.position[:, k] + (x + 1.0 / parts) * motion.position[:, k + 1]
        beyond = (1.0 - x - 1.0 / parts) * motion.velocity[:, k] + (x + 1.0 / parts) * motion.velocity[:, k + 1]
        own = velocity + fast
        off = position + place + step * own + 0.5 * step**2 * push / inertia - there
        touches = held | (np.abs(off) >= half)
        now = np.where(held, side, np.where(touches, np.sign(off), 0.0))
        moved = begun[:, k]
        side = np.where(moved, now, side)
        place = np.where(moved, np.where(touches, now * half, off), place)
        speed = np.where(moved, np.where(touches, 0.0, own + step * push / inertia - beyond), speed)
    return place, speed, side
