"""Fits side by side, of which only the promising ones are worth their time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.gauss_newton import Problem

_RACERS = 3


def give_up(problems: Sequence[Problem], ended: Sequence[float] = (), only_misled: bool = False) -> None:
    """Ends the fits that stay far behind: not among the best three, and not close to the best.

    Args:
        problems: the fits that go on.
        ended: chi2 of those that have ended.
        only_misled: only those whose first guess was worse than the smaller set from which they have yet to begin
            anew. In 45 races with such ones, one of them came first that is given up so, by 22 of 8400.
    """
    levels = np.sort([*(problem.chi2 for problem in problems), *ended])
    best, worst = levels[0], max(levels[np.isfinite(levels)], default=np.inf)
    for problem in problems:
        behind = np.searchsorted(levels, problem.chi2) >= _RACERS and np.isfinite(problem.chi2)
        far = problem.chi2 > best + max(60.0, min(0.1 * (worst - best), 4.0 * best))
        if behind and far and (problem.resting is not None or not only_misled):
            problem.finished = True
