"""What is left because recorded times were rounded, where rows are uneven: neither physics nor an encoder's noise."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch

from torch_activegp.data.noise import quantum
from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.preparation.rivals import beside
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_DRAWS = 4
_LIKELY = 3.0
"""Times the chi2 that rounding leaves in the mean, up to which it may have left it."""
_DIGITS = 9
"""Decimals of times, s, that differences of large numbers of them know."""


def rounding(run: Run) -> float:
    """The step to which the times of a run were rounded, s; zero where rows are even, or no step shows."""
    return quantum(torch.from_numpy(np.round(np.diff(run.time[run.recorded]), _DIGITS)))


def left_by_rounding(shooting: Shooting, fit: Fit) -> float:
    """Chi2 that rounding the recorded times once more would leave behind initial states, in the mean of some draws.

    It is what the first rounding left, for both are alike. Each row of a control acts for as long as the clock says: on
    a slide at 100 Hz under a chirp, times to 0.1 ms left 32 times the noise of 0.06 mm in one of 53 segments, and 2.05
    in all, of a simulator without any fault.

    Args:
        shooting: the likelihood.
        fit: of a set, with derivatives by the states or without.
    """
    segments, rng = shooting.segments, np.random.default_rng(0)
    steps = np.array([rounding(run) for run in segments.runs])[segments.run]
    if not steps.any():
        return 0.0
    if fit.design is None:
        fit = shooting.fit([(fit.effects, fit.values)], fit.starts, rounds=1, hold=True)[0]
    assert fit.design is not None
    candidates, before, left = [fit.candidate], shooting.engine.predict(segments, fit.starts[None], [fit.candidate]), []
    for _ in range(_DRAWS):
        off = steps[:, None] * rng.uniform(-0.5, 0.5, size=(segments.size, segments.intervals + 1))
        rounded = dataclasses.replace(segments, dt=np.maximum(segments.dt + np.diff(off, axis=1), 0.5 * segments.dt))
        moved = shooting.engine.predict(rounded, fit.starts[None], candidates) - before
        left.append(float((beside(fit.design, np.nan_to_num(shooting.noise.whiten(segments, moved[0]))) ** 2).sum()))
    return float(np.mean(left))


def rounded_clock(shooting: Shooting, fit: Fit) -> str:
    """That the rounded clock may have left all that is more than noise, in a sentence; empty where it did not.

    Args:
        shooting: the likelihood.
        fit: the nominal's.
    """
    left = left_by_rounding(shooting, fit)
    if not fit.chi2 - shooting.dof < _LIKELY * left:
        return ""
    step = max(rounding(run) for run in shooting.segments.runs)
    return (
        f"The recorded times are multiples of {step:.2g} s, and rows are uneven: behind controls that change so fast "
        f"that rounding alone leaves about {1.0 + left / shooting.dof:.2g} times the noise (chi2 per dof), and no more "
        "than it may leave is seen. Times with more digits would tell more."
    )
