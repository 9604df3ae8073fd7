"""Errors of positions that come from a video."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Run, median_step

_TIME = 0.6
_ERROR = 4.0
"""The errors of a video (parallax, the lens, who marks a frame) last: frames of falling balls err by 0.1 to 0.15 m for
half a second at a time, and by 0.03 m from one frame to the next."""


def video_errors(runs: Sequence[Run], white: float) -> tuple[tuple[float, float], float] | None:
    """Colour and standard deviation of errors that differ by so much from frame to frame; None where none is a video.

    Args:
        runs: at least one.
        white: by how much they differ, rad or m.
    """
    if not any(run.video for run in runs):
        return None
    return (float(np.exp(-median_step(runs) / _TIME)), 0.0), _ERROR * white
