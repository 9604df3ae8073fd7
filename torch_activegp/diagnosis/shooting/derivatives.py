"""Derivatives of a set's residuals by states and parameters: asked for, lent by a fit near by, kept while they lead."""

from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.differences import Differences
from torch_activegp.diagnosis.shooting.elimination import Eliminated, eliminate
from torch_activegp.diagnosis.shooting.fit import Fit, split
from torch_activegp.diagnosis.shooting.point import Likelihood
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.effect import Effect


class Derivatives:
    """Those of a set on its way to the optimum; several steps go by the same, for they cost most of the simulations.

    Args:
        shooting: the likelihood.
        effects: the set.
        values: its first guess.
        near: a fit of another set near by, which lends its own until they mislead.

    Attributes:
        design: by the states, ``(S, M, n)``; None where they are yet to be taken.
        columns: by the parameters, ``(S, M, P)``; None where they are yet to be taken, P = 0 while these are held.
        taken: where the latter were, ``(P,)``.
        given: those by parameters that are lent, by their places, until they were taken once, ``(S, M)`` each.
        linear: what is left at the best point, linearised by them.
        age: steps that went by them; those that are lent are a step old.
        stale: whether those by the states were lent when it began.
        lent: whether a cheap simulation lends what is taken next.
    """

    linear: Eliminated
    _wanted: Differences

    def __init__(
        self, shooting: Likelihood, effects: tuple[Effect, ...], values: tuple[Array, ...], near: Fit | None = None
    ) -> None:
        self._shooting, self._effects = shooting, effects
        self.given = {} if near is None else near.columns_of(effects, values)
        self.design = None if near is None else near.design
        self.columns: Array | None = None
        self.taken = np.zeros(0)
        self.lent = shooting.lends
        self.stale = self.design is not None
        self.age = int(self.stale)

    def hold(self) -> None:
        """Takes none by the parameters, which are held; they need no simulation, once those by the states are there."""
        if self.design is not None:
            self.columns = np.zeros((*self.design.shape[:2], 0))

    def ask(self, flat: Array, starts: Array, held: bool) -> tuple[list[Candidate], Array]:
        """The point and what is to be simulated beside it: each state moved and each parameter, where not known.

        Args:
            flat: parameters, ``(P,)``.
            starts: initial states, ``(S, n)``.
            held: whether the parameters are; then nothing is asked for them.
        """
        if self.design is not None and self.columns is not None:
            return [Candidate(self._effects, split(self._effects, flat))], starts[None]
        moved = self._shooting.state_columns(starts)[: 0 if self.design is not None else None]
        self._wanted = Differences.of(self._effects, flat, moved, None if held else self.given)
        return self._wanted.candidates(self._effects, flat, starts)

    def take(self, white: Array, flat: Array, held: bool) -> bool:
        """Takes them from whitened residuals ``(N, S, M)`` of what was asked for; returns whether states' are new."""
        new = self.design is None
        if new:
            self.design = self._wanted.by_states(white)
            self.age, self.stale = int(self.lent), self.lent
        given = {} if held else self.given
        self.columns, self.taken = self._wanted.by_parameters(white, given), flat
        if given:
            self.given, self.age = {}, max(self.age, 1)
        return new

    def take_lent(self, flat: Array) -> bool:
        """Takes those by the parameters ``(P,)`` that are lent, where all are; returns whether they were."""
        if len(self.given) != len(flat) or self.design is None:
            return False
        self._wanted = Differences(np.zeros(0))
        self.take(np.zeros((1, *self.design.shape[:2])), flat, held=False)
        return True

    def linearise(self, residual: Array) -> None:
        """At a point with these residuals, ``(S, M)``."""
        assert self.design is not None
        assert self.columns is not None
        self.linear = eliminate(self.design, self.columns, np.nan_to_num(residual))

    def forget(self, states: bool = True, misled: bool = False) -> None:
        """Has those by the parameters taken anew, and those by the states; precise ones where what was lent misled."""
        self.columns, self.design = None, None if states else self.design
        self.lent = self.lent and not misled

    def lend(self, fit: Fit, flat: Array) -> None:
        """Lends those of a fit near by, at parameters ``(P,)``."""
        self.design = fit.design
        self.given = fit.columns_of(self._effects, split(self._effects, flat))
