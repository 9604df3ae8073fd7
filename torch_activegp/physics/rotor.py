"""A rotor: its inertia on a joint, and its way between the ends of a gap along the recorded motion of the joint."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.integer[Any]]


class Past(NamedTuple):
    """What is known of the time before n simulations begin.

    Args:
        time: clocks of whole runs, ``(runs, T)``, s; increasing to the end, also where a run is shorter.
        control: controls between the last so many rows before each, ``(n, rows, nu)``; the first one of a run is held.
    """

    time: Array
    control: Callable[[int], Array]


class Motion(NamedTuple):
    """A joint at B + 1 rows of n recordings, ``(n, B + 1)`` each, in units of the joint, and s."""

    time: Array
    position: Array
    velocity: Array
    acceleration: Array

    @classmethod
    def along(cls, positions: Array, time: Array, span: int) -> Motion:
        """From smoothed positions and clocks ``(n, T)``; differences over so many rows on either side."""
        if positions.shape[1] <= 2 * span:
            return cls(time, positions, np.zeros_like(positions), np.zeros_like(positions))
        before, here, after = slice(None, -2 * span), slice(span, -span), slice(2 * span, None)
        onward = (positions[:, after] - positions[:, here]) / (time[:, after] - time[:, here])
        back = (positions[:, here] - positions[:, before]) / (time[:, here] - time[:, before])
        bent = 2.0 * (onward - back) / (time[:, after] - time[:, before])
        velocity = (positions[:, 2:] - positions[:, :-2]) / (time[:, 2:] - time[:, :-2])
        padded = (np.pad(each, ((0, 0), (n, n)), mode="edge") for each, n in ((velocity, 1), (bent, span)))
        return cls(time, positions, *padded)

    def between(self, row: int, part: float) -> Motion:
        """At a part of the time from a row to the next, ``(n,)`` each."""
        return Motion(*((1.0 - part) * each[:, row] + part * each[:, row + 1] for each in self))

    def at(self, run: NDArray[Any], rows: NDArray[Any]) -> Motion:
        """In some rows ``(n, B + 1)`` of some runs ``(n,)``; at the ends of a run where there is no such row."""
        rows = np.clip(rows, 0, self.position.shape[1] - 1)
        return Motion(*(each[run[:, None], rows] for each in self))


def carried(
    motion: Motion,
    torque: Array,
    begun: NDArray[np.bool_],
    inertia: float,
    half: Array,
    longest: float,
    centred: NDArray[np.bool_],
) -> tuple[Array, Array, Array]:
    """Where a rotor is in the end: against its joint, how fast against it, and on which side it touches, ``(n,)`` each.

    It begins in the middle of the gap, or on the side on which it must push to keep up with the joint. From there on it
    flies freely, or moves with the joint as long as it would not have to pull; where it touches it stays. So each touch
    makes good what was wrong until then.

    Args:
        motion: of the joint at B + 1 rows.
        torque: on the rotor between them, ``(n, B)``, N m or N.
        begun: whether the recording had begun, ``(n, B)``.
        inertia: of the rotor, kg m2 or kg.
        half: half the gap, ``(n,)``, rad or m.
        longest: time step, s.
        centred: whether it begins in the middle, ``(n,)``.
    """
    apart = np.diff(motion.time, axis=1)
    parts = max(int(np.ceil(np.median(apart[begun]) / longest)), 1) if begun.any() else 1
    first = begun.argmax(axis=1)[:, None]
    needed = inertia * np.take_along_axis(motion.acceleration, first, axis=1)[:, 0]
    side = np.where(np.take_along_axis(torque, first, axis=1)[:, 0] < needed, -1.0, 1.0) * ~centred
    place, speed = side * half, np.zeros_like(half)
    for k, part in np.ndindex(torque.shape[1], parts):
        here, there = (motion.between(k, x / parts) for x in (part, part + 1))
        step, push = apart[:, k] / parts, torque[:, k]
        held = (side != 0.0) & (side * (push - inertia * here.acceleration) >= 0.0)
        own = here.velocity + speed  # no speed against the joint where it touched
        off = here.position + place + step * own + 0.5 * step**2 * push / inertia - there.position
        touches = held | (np.abs(off) >= half)
        now = np.where(held, side, np.where(touches, np.sign(off), 0.0))
        moved = begun[:, k]
        side = np.where(moved, now, side)
        place = np.where(moved, np.where(touches, now * half, off), place)
        speed = np.where(moved, np.where(touches, 0.0, own + step * push / inertia - there.velocity), speed)
    return place, speed, side


def add_rotor(field: Callable[[str], Array], rows: Index, dof: int, inertia: Array) -> None:
    """Adds to the inertia of a rotor in some simulations.

    Where a body moves along its principal axes alone, MuJoCo takes ``dof_M0`` for the inertia and looks at
    ``dof_armature`` no more.
    """
    field("dof_armature")[rows, dof] += inertia
    field("dof_M0")[rows, dof] += inertia
