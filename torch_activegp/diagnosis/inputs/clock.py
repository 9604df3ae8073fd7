"""Recorded times that scatter: whether the rows were as uneven as they say is seen by how the machine moved."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from torch_activegp.data import Recording, noise_std, unwrap_angles
from torch_activegp.data.noise import MAD_TO_STD
from torch_activegp.diagnosis.inputs.runs import MISSING, Array, Channels
from torch_activegp.diagnosis.inputs.smoothing import smooth

_ORDER = 6
"""Of the differences between rows, which no motion outlasts."""
_EVEN = 1e-3
"""Part of a row's length by which the times of an even clock scatter at most."""
_AROUND, _DOUBT, _ROUNDS = (1, 3, 5), 0.3, 3
"""Steps in a row by which it is told whether a row is missing in the middle one, where that is in doubt: so much of a
row from whole ones. Of 80000 steps that scatter by 0.25 of a row with one row in five missing, 384 were told wrongly by
the length of each alone, and none so; by 0.3 of a row, 1061 and 293."""
_LASTS, _SLOW = 16, 3.0
"""Means of so many rows that vary by so many times what they would of scatter are of a clock that wanders."""
_APART = 6.0
"""Standard deviations of differences that are no noise: impacts, glitches, leaps of a turn."""
_BLOCK, _BLOCKS = 50, 15
"""Rows of a block, and how many blocks must tell, as many as if all told alike: what knocks a machine is in few."""
_SURE, _SHOWS = 4.0, 0.25
"""Standard errors by which the scatter must not show, and the part of it that may."""


@dataclasses.dataclass(frozen=True)
class Clock:
    """The times of a recording about an even clock.

    Args:
        even: times of the even clock, ``(T,)``, s; rows may be missing.
        off: recorded times less these, ``(T,)``, s.
        following: whether no row is missing between a row and the sixth after it, ``(T - 6,)``.
    """

    even: Array
    off: Array
    following: NDArray[np.bool_]

    @classmethod
    def of(cls, time: Array) -> Clock | None:
        """The clock of some times ``(T,)``; None where they do not scatter, or about no even clock.

        A clock that wanders, or starts anew behind a pause, is no scatter.
        """
        count = len(time) // _LASTS
        if count < 2:
            return None
        rows = np.concatenate([[0.0], np.cumsum(_rows_in(np.diff(time)))])
        slope, first = np.polyfit(rows, time, 1)
        even = first + slope * rows
        off = time - even
        slow = off[: count * _LASTS].reshape(count, _LASTS).mean(axis=1).var()
        if off.std() < _EVEN * slope or slow > _SLOW * off.var() / _LASTS:
            return None
        following = np.lib.stride_tricks.sliding_window_view(np.diff(rows), _ORDER).max(axis=-1) == 1.0
        return cls(even, off, following)

    def shown(self, time: Array, position: Array) -> Array:
        """How much of the scatter a position shows: the sums of a regression in each block of rows, ``(blocks, 2)``.

        Differences between rows in a line leave noise, and of a machine that moves at some speed what its times are
        off an even clock: the product with what they would leave of recorded times that are right, and their square.

        Args:
            time: as recorded, ``(T,)``, s.
            position: ``(T,)``, rad or m.
        """
        floor = noise_std(torch.from_numpy(position.copy()), torch.from_numpy(time.copy()))
        speed = smooth(time, position, floor)[0]
        size = math.sqrt(math.comb(2 * _ORDER, _ORDER))
        found, right = (
            np.where(self.following, np.diff(x, n=_ORDER), 0.0) / size for x in (position, speed * self.off)
        )
        noise = MAD_TO_STD * float(np.median(np.abs(found[self.following]))) if self.following.any() else 0.0
        if noise <= 0.0:
            return np.zeros((1, 2))
        usable = np.abs(found) < _APART * (noise + np.abs(right))
        sums = np.stack([found * right, right**2], axis=1) * usable[:, None] / noise**2
        starts = np.arange(0, len(sums), _BLOCK)
        return np.asarray(np.add.reduceat(sums, starts, axis=0))


@dataclasses.dataclass(frozen=True)
class Shown:
    """The part of the scatter that shows in some motion.

    Args:
        share: the part, 1 where recorded times are right.
        error: its standard error: that of white noise, or how blocks of rows disagree where that is more.
        blocks: how many blocks of rows tell, as many as if all told alike.
    """

    share: float
    error: float
    blocks: float

    @classmethod
    def by(cls, sums: Array) -> Shown:
        """From the sums of blocks of rows, ``(blocks, 2)``."""
        along, square = sums.T
        total = square.sum()
        if total <= 0.0:
            return cls(1.0, np.inf, 0.0)
        share = along.sum() / total
        white = math.sqrt((_ORDER + 1) / total)  # each difference shares rows with so many others
        apart = math.sqrt(((along - share * square) ** 2).sum()) / total
        return cls(float(share), max(white, float(apart)), float(total**2 / (square**2).sum()))

    @property
    def even(self) -> bool:
        """Whether rows were taken evenly: next to nothing of the scatter shows.

        What shows the other way round is no scatter: positions were logged a row late.
        """
        told = self.blocks >= _BLOCKS and self.share + _SURE * self.error < 1.0
        return told and -_SURE * self.error < self.share < _SHOWS


def _rows_in(steps: Array) -> Array:
    """How many rows of an even clock there are in each of five or more steps between recorded rows, ``(T - 1,)``.

    Two neighbours that scatter apart are as far from each other as if one were missing between them, but not so their
    neighbours: one step of 1.504 rows in 1199 made a clock seem to wander. Nor is the median step one row where many
    are missing.
    """
    usual = float(np.median(steps))
    for _ in range(_ROUNDS):
        counts = np.where(steps <= (MISSING + 1e-6) * usual, 1.0, np.rint(steps / usual))
        left = steps / usual - counts
        around = np.median([np.convolve(left, np.ones(width), "same") for width in _AROUND], axis=0)
        counts = np.where(np.abs(left) > _DOUBT, np.maximum(np.rint(counts + around), 1.0), counts)
        usual = float(steps.sum() / counts.sum())
    return np.asarray(counts)


def truer_times(recordings: Sequence[Recording], channels: Channels) -> tuple[list[Recording], str]:
    """The recordings, at the times of an even clock where they were taken so, and what was changed, in a sentence.

    Computers stamp rows when they come to it, of machines that were sampled evenly; others are sampled unevenly and
    say so. Where times are right, a moving machine is seen off its path by its speed times what they are off an even
    clock. The slope of that regression is the part of the scatter that is true: of all recordings, or of each where
    they disagree. Stamps that were off by 0.4 ms left three times the noise of a falling pendulum in free decay.

    Args:
        recordings: one or more.
        channels: the recorded joints.

    Returns:
        The same recordings, and an empty sentence, where the times are right or even, or nothing tells.
    """
    hinges = [joint for joint, hinge in zip(channels.joints, channels.hinge, strict=True) if hinge]
    clocks, sums = {}, {}
    for i, recording in enumerate(recordings):
        time = recording.time.numpy()
        if (clock := Clock.of(time)) is not None:
            run, clocks[i] = unwrap_angles(recording, hinges), clock
            sums[i] = np.concatenate([clock.shown(time, run[f"qpos.{joint}"].numpy()) for joint in channels.joints])
    if not sums:
        return [*recordings], ""
    whole, each = Shown.by(np.concatenate([*sums.values()])), {i: Shown.by(some) for i, some in sums.items()}
    alike = all(abs(one.share - whole.share) < _SURE * one.error for one in each.values())
    even = [i for i in sums if (whole if alike else each[i]).even]
    if not even:
        return [*recordings], ""
    moved = [*recordings]
    for i in even:
        moved[i] = recordings[i].replace({"time": torch.from_numpy(clocks[i].even)})
    which = "" if len(even) == len(recordings) else f" of {', '.join(recordings[i].label for i in even)}"
    scatter = max(clocks[i].off.std() for i in even)
    shown = Shown.by(np.concatenate([sums[i] for i in even]))
    return moved, (
        f"Recorded times{which} scatter by {1e3 * scatter:.2g} ms about an even clock, of which "
        f"{max(shown.share, 0.0):.0%} shows in the motion, give or take {2.0 * shown.error:.0%}: their rows are taken "
        "to be even."
    )
