"""Which states are sought next, and how, where a step of the parameters or a first guess made segments worse."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.following import SLOWER, Follower, OtherSteps, StatesAlone
from torch_activegp.diagnosis.shooting.point import Likelihood, Point
from torch_activegp.diagnosis.simulation.candidate import Candidate

_DETOURS = 2
"""At one point: 120 of 271 first ones led on, 11 of 80 second ones, and 2 of 87 later ones."""
_LITTLE, _WORSE = 0.05, 1.0
_FEW, _LONG = 0.25, 12
"""Part of the segments that are few, and rounds for the states of these."""


class Followers:
    """Makes them for one fit: each kind once for a trial, and fits of the states alone twice at any point.

    Args:
        shooting: the likelihood.
        smooth: states by the smoothed recording, ``(S, n)``; None where these are not tried.

    Attributes:
        rescued: whether the states of the first guess were sought.
    """

    def __init__(self, shooting: Likelihood, smooth: Array | None) -> None:
        self._shooting, self._smooth = shooting, smooth
        self._tried, self.detours, self.rescued = 0, _DETOURS, False

    def new_trial(self) -> None:
        """Begins with the first kind."""
        self._tried = 0

    def new_point(self) -> None:
        """Lets fits of the states alone be tried twice more."""
        self.detours = _DETOURS

    def behind(
        self,
        trial: Candidate,
        point: Point,
        residual: Array,
        before: Point,
        shift: Callable[[float], Array],
        hopeful: bool,
    ) -> Follower | None:
        """For the segments that a step made worse; None where there are none, or every kind was tried.

        Args:
            trial: the model at the step.
            point: its parameters and states, and how well they fit.
            residual: there, ``(S, M)``.
            before: from where the step went.
            shift: the states' step by damping, ``(S, n)``.
            hopeful: whether the step promised much.
        """
        worse = point.per_segment > before.per_segment + _LITTLE
        if not worse.any():
            return None
        self._tried += 1
        if self._tried == 1:
            ways = [before.starts + shift(damping) for damping in SLOWER]
            ways += [] if self._smooth is None else [self._smooth]
            return OtherSteps(trial, point, residual, worse, ways)
        if self._tried == 2 and self._smooth is not None and hopeful and self.detours:
            self.detours -= 1
            return StatesAlone(self._shooting, trial, point, residual, worse)
        return None

    def rescue(self, trial: Candidate, point: Point, residual: Array, smaller: Array) -> Follower | None:
        """For the segments in which a first guess is worse than a smaller set, once, where these are few.

        What a machine strikes once shows in one of forty segments. Derivatives from before it struck lead its states
        nowhere: a stop stood at 900 times the noise and was given up; with states of its own it left 1.04 times.

        Args:
            trial: the model at the first guess.
            point: its parameters and states, and how well they fit.
            residual: there, ``(S, M)``.
            smaller: chi2 of the smaller set, ``(S,)``.
        """
        worse: NDArray[np.bool_] = point.per_segment > smaller + _WORSE
        if self.rescued or not 0.0 < worse.mean() <= _FEW:
            return None
        self.rescued = True
        return StatesAlone(self._shooting, trial, point, residual, worse, _LONG)
