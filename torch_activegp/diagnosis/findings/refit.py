"""Fits to parts of the segments, close to the fit to all of them: Gauss-Newton with derivatives that are taken once."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.elimination import bounded_step, eliminate
from torch_activegp.diagnosis.shooting.fit import Fit, bounds, difference_steps, split
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.point import FAILED, chi2_of
from torch_activegp.diagnosis.simulation.candidate import Candidate

_ROUNDS = 6
_LITTLE = 1e-3
_UNSETTLED = 2.0
_SHORTER = 0.3
_WORSE = 3.0
"""A segment whose chi2 rises by more has not followed."""
_MANY = 0.5
_HOLD = 1e-6
"""What a part says less about than this share of all the data stays where it was."""


@dataclasses.dataclass(frozen=True)
class Refits:
    """One set of effects, fitted R times.

    Args:
        values: the parameters of all effects in a row, ``(R, P)``.
        per_segment: chi2 of every segment with its initial state free, also where the segment was left out,
            ``(R, S)``; infinite where the simulation fails.
    """

    values: Array
    per_segment: Array


def refit(shooting: Shooting, fit: Fit, kept: NDArray[np.bool_]) -> Refits:
    """Fits a set again to parts of the data, all parts side by side.

    Args:
        shooting: the likelihood of all S segments.
        fit: the set, fitted to all of them.
        kept: the segments that each of R parts has, ``(R, S)``.
    """
    if not fit.size:
        per_segment = np.where(fit.per_segment < FAILED, fit.per_segment, np.inf)
        return Refits(np.zeros((len(kept), 0)), np.tile(per_segment, (len(kept), 1)))
    if fit.design is None:
        fit = shooting.fit([(fit.effects, fit.values)], fit.starts, rounds=1)[0]
    residual, columns = _derivatives(shooting, fit)
    parts = [_Part(shooting, fit, columns, residual, part) for part in kept]
    for _ in range(_ROUNDS):
        live = [part for part in parts if not part.finished]
        if not live:
            break
        states = np.stack([part.trial_starts for part in live])
        predicted = shooting.engine.predict(shooting.segments, states, [_at(fit, p.trial) for p in live])
        for part, white in zip(live, shooting.residuals(predicted), strict=True):
            part.tell(white)
    _settle(shooting, fit, parts)
    return Refits(np.stack([part.values for part in parts]), np.stack([part.per_segment for part in parts]))


def _settle(shooting: Shooting, fit: Fit, parts: Sequence[_Part]) -> None:
    """Fits initial states of what was left out where they did not follow the parameters: where a joint sticks, say."""
    for part in parts:
        bad = ~part.kept & (part.per_segment > fit.per_segment + _WORSE)
        if bad.any():
            candidate = _at(fit, part.values)
            again = shooting.pick(bad).fit([(candidate.effects, candidate.values)], fit.starts[bad], hold=True)[0]
            part.per_segment[bad] = np.minimum(part.per_segment[bad], again.per_segment)


def _at(fit: Fit, flat: Array) -> Candidate:
    return Candidate(fit.effects, split(fit.effects, flat))


def _derivatives(shooting: Shooting, fit: Fit) -> tuple[Array, Array]:
    """Whitened residuals ``(S, M)`` and their derivatives by the parameters ``(S, M, P)`` at a fit."""
    flat = np.concatenate(fit.values)
    steps = difference_steps(fit.effects, flat)
    candidates = [_at(fit, flat), *(_at(fit, flat + step) for step in np.diag(steps))]
    states = np.repeat(fit.starts[None], len(candidates), axis=0)
    white = shooting.residuals(shooting.engine.predict(shooting.segments, states, candidates))
    moved = -(white[1:] - white[0]) / steps[:, None, None]
    return white[0], np.nan_to_num(moved, posinf=0.0, neginf=0.0).transpose(1, 2, 0)


def _badness(per_segment: Array) -> tuple[int, float]:
    """How many segments fail, and chi2 of the others."""
    fails = np.isinf(per_segment)
    return int(fails.sum()), float(per_segment[~fails].sum())


class _Part:
    """The fit to a part on its way."""

    def __init__(self, shooting: Shooting, fit: Fit, columns: Array, residual: Array, kept: NDArray[np.bool_]) -> None:
        assert fit.design is not None
        self.values, self.starts, self.finished = np.concatenate(fit.values), fit.starts, False
        self.kept, self._design, self._columns = kept, fit.design, columns
        self._reach = shooting.state_reach()
        self._low, self._high = bounds(fit.effects)
        self._little = difference_steps(fit.effects, self.values)
        self._length = 1.0
        self._accept(residual, chi2_of(residual, failed=np.inf))

    def tell(self, white: Array) -> None:
        """Takes the whitened residuals ``(S, M)`` of the trial: accepts it, or blames segments or the step's length."""
        per_segment = chi2_of(white, failed=np.inf)
        worse = per_segment > self.per_segment + _WORSE
        if _badness(per_segment[self.kept]) <= _badness(self.per_segment[self.kept]):
            self.values, self.starts = self.trial, self.trial_starts
            self._length = min(1.0, self._length / _SHORTER)
            self._accept(white, per_segment)
        elif (self._follow[worse] == 1.0).any() and worse.mean() < _MANY:
            self._follow[worse] = 0.0
            self._propose()
        else:
            self._length *= _SHORTER
            self._propose()

    def _accept(self, residual: Array, per_segment: Array) -> None:
        self._linear = eliminate(self._design, self._columns, np.nan_to_num(residual, posinf=0.0, neginf=0.0))
        self.per_segment = per_segment
        self._follow = np.ones(len(per_segment))
        self._propose()

    def _propose(self) -> None:
        linear, kept = self._linear, self.kept
        normal, gradient = linear.normal[kept].sum(0), linear.gradient[kept].sum(0)
        hold = _HOLD * np.diag(np.diag(linear.normal.sum(0)))
        delta = bounded_step(normal + hold, gradient, 0.0, self.values, self._low, self._high, self._little)
        shift = self._follow[:, None] * linear.states(delta, self._reach)
        gain = 2 * gradient @ delta - delta @ normal @ delta
        settled = (np.einsum("smn,sm->sn", linear.basis, linear.residual) ** 2).sum() < _UNSETTLED / self._length
        self.finished = bool(gain < _LITTLE and settled)
        self.trial, self.trial_starts = self.values + self._length * delta, self.starts + self._length * shift
