"""Rows in which a recorder lost its position for a moment: they belong to no motion, and count for nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from torch_activegp.data.outliers import outlying

Array = NDArray[np.float64]
_MOST = 0.05
"""Part of the rows. Where more lie apart it is not for a moment: that is how the recorder works."""


class Glitches(NamedTuple):
    """What was found.

    Args:
        lost: whether each position is a glitch, ``(T, C)``.
        kept: part of the rows that lie apart in a channel and count all the same, for they are too many, ``(C,)``.
    """

    lost: NDArray[np.bool_]
    kept: Array


def glitches(time: Array, position: Array, noise: Array) -> Glitches:
    """Which positions are glitches; none in a channel where more than 5 % of the rows lie apart.

    Args:
        time: ``(T,)``, s.
        position: ``(T, C)``.
        noise: standard deviations, ``(C,)``.
    """
    clock = torch.from_numpy(time.copy())
    each = zip(position.T, noise, strict=True)
    found = np.stack([outlying(torch.from_numpy(signal.copy()), clock, float(sigma)) for signal, sigma in each], axis=1)
    share = found.mean(axis=0)
    return Glitches(np.asarray(found & (share <= _MOST)), np.where(share > _MOST, share, 0.0))


def bridged(time: Array, position: Array, lost: NDArray[np.bool_]) -> Array:
    """Positions ``(T, C)`` with a straight line over each that is lost."""
    return np.stack(
        [
            np.interp(time, time[~gone], signal[~gone]) if gone.any() else signal
            for signal, gone in zip(position.T, lost.T, strict=True)
        ],
        axis=1,
    )


def in_words(time: Array, found: Glitches, joints: Sequence[str]) -> tuple[str, ...]:
    """What was left out, a sentence for each channel, and what was not although it looks like glitches."""
    out = []
    for joint, gone, kept in zip(joints, found.lost.T, found.kept, strict=True):
        if count := int(gone.sum()):
            what = f"{count} rows left out, the first" if count > 1 else "a row left out,"
            where = f"at {time[gone][0]:.6g} s"
            out.append(f"{what} {where}: qpos.{joint} is far from where the rows around it put it.")
        if kept:
            out.append(
                f"{100 * kept:.0f} % of the rows of qpos.{joint} are far from where the rows around put them. They "
                "count as they are, for they are too many for glitches: look at that sensor."
            )
    return tuple(out)
