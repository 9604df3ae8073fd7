"""Rows in which a recorder lost its position for a moment: they belong to no motion, and count for nothing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from torch_activegp.data.outliers import outlying

Array = NDArray[np.float64]
_MOST = 0.05
"""Part of the rows. Where more lie apart it is not for a moment: that is how the recorder works."""


def glitches(time: Array, position: Array, noise: Array) -> NDArray[np.bool_]:
    """Whether each position is a glitch.

    Args:
        time: ``(T,)``, s.
        position: ``(T, C)``.
        noise: standard deviations, ``(C,)``.

    Returns:
        ``(T, C)``; none in a channel where that would be more than 5 % of the rows.
    """
    clock = torch.from_numpy(time.copy())
    each = zip(position.T, noise, strict=True)
    found = np.stack([outlying(torch.from_numpy(signal.copy()), clock, float(sigma)) for signal, sigma in each], axis=1)
    return np.asarray(found & (found.mean(axis=0) <= _MOST))


def bridged(time: Array, position: Array, lost: NDArray[np.bool_]) -> Array:
    """Positions ``(T, C)`` with a straight line over each that is lost."""
    return np.stack(
        [
            np.interp(time, time[~gone], signal[~gone]) if gone.any() else signal
            for signal, gone in zip(position.T, lost.T, strict=True)
        ],
        axis=1,
    )


def in_words(time: Array, lost: NDArray[np.bool_], joints: Sequence[str]) -> tuple[str, ...]:
    """What was left out, a sentence for each channel."""
    out = []
    for joint, gone in zip(joints, lost.T, strict=True):
        if count := int(gone.sum()):
            what = f"{count} rows left out, the first" if count > 1 else "a row left out,"
            where = f"at {time[gone][0]:.6g} s"
            out.append(f"{what} {where}: qpos.{joint} is far from where the rows around it put it.")
    return tuple(out)
