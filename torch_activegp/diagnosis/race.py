"""Fits side by side, of which only the promising ones are worth their time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.gauss_newton import Problem

_RACERS = 3


def give_up(problems: Sequence[Problem]) -> None:
    """Ends the fits that stay far behind: not among the best three, and not close to the best."""
    order = sorted(problems, key=lambda p: p.chi2)
    best, worst = order[0].chi2, max((p.chi2 for p in order if np.isfinite(p.chi2)), default=np.inf)
    for problem in order[_RACERS:]:
        if np.isfinite(problem.chi2) and problem.chi2 > best + max(60.0, min(0.1 * (worst - best), 4.0 * best)):
            problem.finished = True
