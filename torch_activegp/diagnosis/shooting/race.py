"""Fits side by side, of which only the promising ones are worth their time."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.shooting.fit import Fit, plausible, split
from torch_activegp.diagnosis.shooting.gauss_newton import Problem
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.effect import Effect

RACERS = 3
"""Sets that go on in any case."""
_CLOSE, _NEAR, _TIMES = 60.0, 0.1, 4.0
"""Chi2 by which a set may be behind the best one and go on: so much, or a part of what lies between the best and the
worst, but no more than so many times what the best one leaves."""


def reach(best: float, worst: float) -> float:
    """The chi2 up to which sets go on in a race whose best one leaves the first, and the worst the second."""
    return best + max(_CLOSE, min(_NEAR * (worst - best), _TIMES * best))


@dataclasses.dataclass(frozen=True)
class Race:
    """Which of some fits side by side go on.

    Args:
        score: how sets compare in the end; None where what they leave alone counts.
        nominal: chi2 without effects, where there is a score.
        dof: degrees of freedom, where there is a score.
    """

    score: Score | None = None
    nominal: float = np.inf
    dof: int = 1

    def give_up(self, problems: Sequence[Problem], ended: Sequence[Fit] = (), only_misled: bool = False) -> None:
        """Ends the fits that stay far behind: not of the best three sets, or of the best three of theirs; not close.

        Those stay that wait (:attr:`Problem.waits`), as for a first step that promises most and was neither taken nor
        refused yet: where a slide sticks (EMPS), the right one sought the states that follow it for ten rounds, and
        then left a sixtieth of what others did.

        And those that cost so much more than a set which leaves little more than noise that they could not become the
        best: 26 sets around a viscous friction on a machine that strikes took 70 s, for 25 s without them.

        Args:
            problems: the fits that go on.
            ended: those that have ended.
            only_misled: only those whose first guess was worse than the smaller set from which they have yet to begin
                anew. In 45 races with such ones, one of them came first that is given up so, by 22 of 8400.
        """
        each = _by_set([*problems, *ended])
        first, every = np.sort([min(some) for some in each.values()]), np.concatenate([*each.values()])
        best, worst = first[0], max(every[np.isfinite(every)], default=np.inf)
        for problem in problems:
            among = (first, np.sort(each[frozenset(problem.effects)]))
            behind = np.isfinite(problem.chi2) and max(np.searchsorted(some, problem.chi2) for some in among) >= RACERS
            far = np.isfinite(best) and problem.chi2 > reach(best, worst)
            if behind and far and (problem.resting is not None or not (only_misled or problem.waits)):
                problem.finished = True
        if not only_misled:
            self._too_dear(problems, ended)

    def _too_dear(self, problems: Sequence[Problem], ended: Sequence[Fit]) -> None:
        """Ends those that could not become the best by what they cost."""
        if self.score is None or self.score.free:
            return
        points = [(p.effects, split(p.effects, p.best.flat), p.best.chi2) for p in problems if p.best is not None]
        points += [(fit.effects, fit.values, fit.chi2) for fit in ended if not fit.at_rest]
        sound = [(effects, chi2) for effects, values, chi2 in points if plausible(effects, values)]
        if not sound:
            return
        score = self.score.seeing(min(chi2 for _, chi2 in sound) / self.dof, self.nominal, self.dof)
        effects, chi2 = min(sound, key=lambda one: one[1] + score.scale * score.price(one[0]))
        for problem in problems:
            problem.finished |= not score.may_beat(problem.effects, effects, chi2, self.dof)


def _by_set(fits: Sequence[Fit | Problem]) -> dict[frozenset[Effect], list[float]]:
    """Chi2 of the fits of each set: one that began from three first guesses takes no three places."""
    each: dict[frozenset[Effect], list[float]] = {}
    for fit in fits:
        each.setdefault(frozenset(fit.effects), []).append(fit.chi2)
    return each
