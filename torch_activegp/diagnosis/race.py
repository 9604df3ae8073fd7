"""Fits side by side, of which only the promising ones are worth their time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.gauss_newton import Problem

_RACERS = 3


def give_up(problems: Sequence[Problem], ended: Sequence[float] = ()) -> None:
    """Ends the fits that stay far behind: not among the best three, and not close to the best.

    Args:
        problems: the fits that go on.
        ended: chi2 of those that have ended.
    """
    levels = np.sort([*(problem.chi2 for problem in problems), *ended])
    best, worst = levels[0], max(levels[np.isfinite(levels)], default=np.inf)
    for problem in problems:
        behind = np.searchsorted(levels, problem.chi2) >= _RACERS and np.isfinite(problem.chi2)
        if behind and problem.chi2 > best + max(60.0, min(0.1 * (worst - best), 4.0 * best)):
            problem.finished = True
