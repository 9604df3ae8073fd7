"""How initial states follow a step of the parameters that made some segments worse: other steps, or a fit of theirs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.elimination import eliminate
from torch_activegp.diagnosis.shooting.point import Likelihood, Point, chi2_of
from torch_activegp.diagnosis.simulation.candidate import Candidate

SLOWER = (1e-3, 1e-2, 0.1, 1.0, 10.0)
"""Dampings of the states' steps that are tried side by side, in units of the diagonal of their normal matrix. On a
slide that sticks (EMPS) a place and a speed at the beginning show in the same way, and the whole step goes anywhere:
the best of these took chi2 of single segments from 94 to 2, 48 to 14 and 4.7 to 1.1 per degree of freedom of all, where
shorter steps in the same direction did next to nothing."""
_ROUNDS = 6
_MUCH = 0.02


class Follower(Protocol):
    """Seeks states by which some segments follow a step: it asks for simulations and is told their residuals.

    Attributes:
        only: which segments it wants simulated, ``(S,)``.
        point: the trial, with the best states so far.
        residual: there, ``(S, M)``.
        chosen: for each segment which of the states asked for are the best, from 1 on, or 0 for what was known before.
        ends: whether it wants no further round.
    """

    only: NDArray[np.bool_]
    point: Point
    residual: Array
    chosen: NDArray[np.int64]
    ends: bool

    def ask(self) -> tuple[list[Candidate], Array]:
        """N candidates and their initial states ``(N, S, n)``."""
        ...

    def tell(self, white: Array) -> None:
        """Takes whitened residuals ``(N, S, M)``."""
        ...


class OtherSteps:
    """One round of several steps side by side.

    Args:
        trial: the model at the parameters.
        point: its states after the whole step, and how well they fit.
        residual: there, ``(S, M)``.
        only: the segments in question, ``(S,)``.
        ways: other states, ``(W, S, n)``.
    """

    def __init__(
        self, trial: Candidate, point: Point, residual: Array, only: NDArray[np.bool_], ways: Sequence[Array]
    ) -> None:
        self.only, self.point, self.residual = only, point, residual
        self.chosen, self.ends = np.zeros(len(only), dtype=np.int64), True
        self._trial, self._ways = trial, np.stack(ways)

    def ask(self) -> tuple[list[Candidate], Array]:
        """The trial with all of the states."""
        return [self._trial] * len(self._ways), self._ways

    def tell(self, white: Array) -> None:
        """Takes the best for each segment."""
        white = np.concatenate([self.residual[None], white])
        starts = np.concatenate([self.point.starts[None], self._ways])
        self.chosen, each = np.where(self.only, chi2_of(white).argmin(axis=0), 0), np.arange(len(self.only))
        self.residual = white[self.chosen, each]
        self.point = Point(self.point.flat, starts[self.chosen, each], chi2_of(self.residual))


class StatesAlone:
    """Rounds of derivatives by the states at the parameters of the trial, and of several steps side by side.

    What stuck before may slip now, and derivatives from before know nothing of it.

    Args:
        shooting: the likelihood.
        trial: the model at the parameters.
        point: where the states are, and how well they fit.
        residual: there, ``(S, M)``.
        only: the segments in question, ``(S,)``.
        rounds: simulations at most, one after the other.
    """

    def __init__(
        self,
        shooting: Likelihood,
        trial: Candidate,
        point: Point,
        residual: Array,
        only: NDArray[np.bool_],
        rounds: int = _ROUNDS,
    ) -> None:
        self.only, self.point, self.residual = only, point, residual
        self.chosen, self.ends = np.zeros(len(only), dtype=np.int64), False
        self._trial, self._steps, self._reach = trial, shooting.state_columns(point.starts), shooting.state_reach()
        self._design: Array | None = None
        self._others: OtherSteps | None = None
        self._rounds = rounds

    def ask(self) -> tuple[list[Candidate], Array]:
        """The trial with each state moved, or with several steps of the states."""
        if self._others is not None:
            return self._others.ask()
        moved = self.point.starts + np.diag(self._steps)[:, None, :]
        return [self._trial] * len(moved), moved

    def tell(self, white: Array) -> None:
        """Takes derivatives, or the best step for each segment."""
        self._rounds -= 1
        if self._others is None:
            slopes = (self.residual - white) / self._steps[:, None, None]
            self._design = np.nan_to_num(slopes, posinf=0.0, neginf=0.0).transpose(1, 2, 0)
        else:
            self._others.tell(white)
            old, self.point, self.residual = self.point, self._others.point, self._others.residual
            fell = old.chi2 - self.point.chi2
            self.ends = not fell > _MUCH * self.point.per_segment[self.only].sum()
            self.only = self.only & (self._others.chosen > 0)
            self._design = None
        self.ends |= self._rounds <= 0
        self._others = None if self._design is None else self._next(self._design)

    def _next(self, design: Array) -> OtherSteps:
        none = np.zeros((*self.residual.shape, 0))
        linear = eliminate(design, none, np.nan_to_num(self.residual))
        ways = [self.point.starts + linear.states(np.zeros(0), self._reach, damping) for damping in (0.0, *SLOWER)]
        return OtherSteps(self._trial, self.point, self.residual, self.only, ways)
