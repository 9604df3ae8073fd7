"""A rotor: its inertia on a joint, and its way between the ends of a gap along the recorded motion of the joint."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.integer[Any]]


class Past(NamedTuple):
    """What is known of the time before n simulations begin.

    Args:
        time: clocks of whole runs, ``(runs, T)``, s; increasing to the end, also where a run is shorter.
        same: a number for each, ``(n,)``, that those share whose controls are the same in the same rows of a run.
        control: controls between the last so many rows before some of them ``(m,)``, ``(m, rows, nu)``; the first one
            of a run is held.
    """

    time: Array
    same: NDArray[Any]
    control: Callable[[NDArray[Any], int], Array]


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

    def finer(self, parts: int) -> Motion:
        """At B parts + 1 instants, so many to a row, on a line from row to row."""
        share = np.arange(parts) / parts
        lines = (each[:, :-1, None] + share * np.diff(each, axis=1)[:, :, None] for each in self)
        flat = (line.reshape(len(line), -1) for line in lines)
        return Motion(*(np.concatenate([line, each[:, -1:]], axis=1) for line, each in zip(flat, self, strict=True)))

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
    parts: int,
    centred: NDArray[np.bool_],
    damping: float = 0.0,
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
        parts: time steps from row to row.
        centred: whether it begins in the middle, ``(n,)``.
        damping: of the rotor, N m s/rad or N s/m.
    """
    first = begun.argmax(axis=1)[:, None]
    needed, braked = (np.take_along_axis(each, first, axis=1)[:, 0] for each in (motion.acceleration, motion.velocity))
    pushes = np.take_along_axis(torque, first, axis=1)[:, 0] - damping * braked
    side = np.where(pushes < inertia * needed, -1.0, 1.0) * ~centred
    place, speed = side * half, np.zeros_like(half)
    # what each step adds to offset and speed against the joint where it flies, and what pushes it where it touches
    fine, moved = motion.finer(parts), np.repeat(begun, parts, axis=1)
    push, step = np.repeat(torque, parts, axis=1) - damping * fine.velocity[:, :-1], np.diff(fine.time, axis=1)
    faster = step * push / inertia
    off = np.where(moved, step * (fine.velocity[:, :-1] + 0.5 * faster) - np.diff(fine.position, axis=1), 0.0)
    faster = np.where(moved, faster - np.diff(fine.velocity, axis=1), 0.0)
    pushed = np.where(moved, push - inertia * fine.acceleration[:, :-1], side[:, None])
    slower = np.exp(-damping * step / inertia)
    for each, now_off, now_faster, now_slower, now_pushed in zip(
        step.T, off.T, faster.T, slower.T, pushed.T, strict=True
    ):
        held = (side != 0.0) & (side * now_pushed >= 0.0)
        free = place + each * speed + now_off
        side = np.where(held, side, np.sign(free) * (np.abs(free) >= half))
        place = np.where(side != 0.0, side * half, free)
        speed = np.where(side != 0.0, 0.0, now_slower * speed + now_faster)
    return place, speed, side


def whole_inertia(model: mujoco.MjModel, dof: int) -> float:
    """What a force on a joint feels where the others are free, kg m2 or kg, with its armature.

    ``dof_invweight0`` is no measure: on a slide whose body turns with nothing it leaves out the armature.
    """
    data, felt = mujoco.MjData(model), np.zeros((1, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_solveM(model, data, felt, np.eye(model.nv)[dof : dof + 1])
    return float(1.0 / max(felt[0, dof], 1e-12))


def add_rotor(
    field: Callable[[str], Array], rows: Index, dof: int, inertia: Array, damping: Array | float = 0.0
) -> None:
    """Adds to the inertia and the damping of a rotor in some simulations.

    Where a body moves along its principal axes alone, MuJoCo takes ``dof_M0`` for the inertia and looks at
    ``dof_armature`` no more.
    """
    field("dof_armature")[rows, dof] += inertia
    field("dof_M0")[rows, dof] += inertia
    if np.any(damping):
        field("dof_damping")[rows, dof] += damping
