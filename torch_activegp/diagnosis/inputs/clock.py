"""Recorded times that scatter: whether the rows were as uneven as they say is seen by how the machine moved."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from torch_activegp.data import Recording, noise_std, unwrap_angles
from torch_activegp.diagnosis.inputs.runs import MIN_ROWS, MISSING, Array, Channels
from torch_activegp.diagnosis.inputs.smoothing import smooth

_ORDER = 6
"""Of the differences between rows, which no motion outlasts."""
_EVEN = 1e-3
"""Part of a row's length by which the times of an even clock scatter at most."""
_LASTS = 0.5
"""Correlation from row to row of what is no scatter: a clock that wanders."""
_APART = 6.0
"""Standard deviations of differences that are no noise: impacts, glitches, leaps of a turn."""
_SURE, _TRUE = 4.0, 0.9
"""Standard errors, and the share, by which too little of the scatter shows in the motion."""
_NONE = 0.1


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
        if len(time) < MIN_ROWS:
            return None
        steps = np.diff(time) / np.median(np.diff(time))
        rows = np.concatenate([[0.0], np.cumsum(np.where(steps <= MISSING + 1e-6, 1.0, np.rint(steps)))])
        slope, first = np.polyfit(rows, time, 1)
        even = first + slope * rows
        off = time - even
        if off.std() < _EVEN * slope or np.corrcoef(off[1:], off[:-1])[0, 1] > _LASTS:
            return None
        following = np.lib.stride_tricks.sliding_window_view(np.diff(rows), _ORDER).max(axis=-1) == 1.0
        return cls(even, off, following)

    def shown(self, time: Array, position: Array) -> Array:
        """How much of the scatter a position shows: the sums of a regression, ``(2,)``.

        Differences between rows in a line leave noise, and of a machine that moves at some speed what its times are
        off an even clock: the product with what they would leave of recorded times that are right, and their square.
        """
        noise = noise_std(torch.from_numpy(position.copy()), torch.from_numpy(time.copy()))
        speed = smooth(time, position, noise)[0]
        size = math.sqrt(math.comb(2 * _ORDER, _ORDER))
        found, right = (np.diff(x, n=_ORDER)[self.following] / size for x in (position, speed * self.off))
        if not len(found):
            return np.zeros(2)
        noise = 1.4826 * min(float(np.median(np.abs(found - part))) for part in (0.0, right))
        usable = np.abs(found) < _APART * (noise + np.abs(right))
        if noise <= 0.0 or not usable.any():
            return np.zeros(2)
        found, right = found[usable] / noise, right[usable] / noise
        return np.array([found @ right, right @ right])


def truer_times(recordings: Sequence[Recording], channels: Channels) -> tuple[list[Recording], str]:
    """The recordings at the times at which their rows were most likely taken, and what was changed, in a sentence.

    Computers stamp rows when they come to it, of machines that were sampled evenly; others are sampled unevenly and
    say so. Where times are right, a moving machine is seen off its path by its speed times what they are off an even
    clock. The slope of that regression, the same for all recordings, is the part of the scatter that is true, and all
    that is kept of it. Stamps that were off by 0.4 ms left three times the noise of a falling pendulum in free decay.

    Args:
        recordings: of one logger.
        channels: the recorded joints.

    Returns:
        The same recordings, and an empty sentence, where the times are right, even, or nothing tells.
    """
    clocks = [Clock.of(recording.time.numpy()) for recording in recordings]
    hinges = [joint for joint, hinge in zip(channels.joints, channels.hinge, strict=True) if hinge]
    along = square = 0.0
    for recording, clock in zip(recordings, clocks, strict=True):
        if clock is not None:
            turned = unwrap_angles(recording, hinges)
            for joint in channels.joints:
                sums = clock.shown(recording.time.numpy(), turned[f"qpos.{joint}"].numpy())
                along, square = along + sums[0], square + sums[1]
    if square <= 0.0:
        return [*recordings], ""
    share, error = along / square, math.sqrt((_ORDER + 1) / square)  # differences share rows with so many others
    if share + _SURE * error > 1.0 or share > _TRUE:
        return [*recordings], ""
    share = max(share, 0.0) if share > _NONE else 0.0
    moved = [
        recording if clock is None else recording.replace({"time": torch.from_numpy(clock.even + share * clock.off)})
        for recording, clock in zip(recordings, clocks, strict=True)
    ]
    scatter = max(clock.off.std() for clock in clocks if clock is not None)
    kept = f"{share:.0%} of that is kept" if share else "they are taken to be even"
    return moved, (
        f"Recorded times scatter by {1e3 * scatter:.2g} ms about an even clock, and the machine moved as if its rows "
        f"were taken more evenly ({share:.0%} of the scatter shows in the motion, give or take {2.0 * error:.0%}): "
        f"{kept}."
    )
