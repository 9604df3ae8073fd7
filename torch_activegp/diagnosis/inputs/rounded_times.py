"""To what the times of rows were rounded."""

from __future__ import annotations

import numpy as np
import torch

from torch_activegp.data.noise import quantum
from torch_activegp.diagnosis.inputs.runs import Run

_FINE = 0.2
"""Part of a row's length that a step of the clock is at most: rows may be so many ticks of an exact clock apart."""
_DIGITS = 9
"""Decimals of times, s, that are not rounding errors of their differences."""


def rounding(run: Run) -> float:
    """The step to which the times of a run were rounded, s; zero where rows are even, or no step shows."""
    beside_another = run.recorded[1:] & run.recorded[:-1]  # rows that were filled in are at no recorded time
    lengths = np.round(run.dt[beside_another], _DIGITS)
    step = quantum(torch.from_numpy(lengths)) if len(lengths) else 0.0
    return step if step < _FINE * float(np.median(run.dt)) else 0.0
