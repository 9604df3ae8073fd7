"""Gauss-Newton with damping for one set of effects: it asks for simulations and is told their residuals."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.brakes import Brakes
from torch_activegp.diagnosis.shooting.derivatives import Derivatives
from torch_activegp.diagnosis.shooting.fit import Fit, inside, resting, split
from torch_activegp.diagnosis.shooting.followers import Followers
from torch_activegp.diagnosis.shooting.following import Follower
from torch_activegp.diagnosis.shooting.patience import Patience
from torch_activegp.diagnosis.shooting.point import Likelihood, Point, chi2_of, total
from torch_activegp.diagnosis.shooting.trust import Trust
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.effect import Effect

SETTLE, _MUCH, _LITTLE, _HOPE, _MOST = 4, 0.02, 0.05, 0.01, 0.5
_STALE = 2
"""Steps with old derivatives by the states, before new ones where the last step still changed much."""
_FAR = 1.3
"""Times the noise from which on lent derivatives end elsewhere than precise ones; below, well within the intervals."""
_KEPT = 0.2
"""Part of what it promised that a step takes away which helps much."""
_ALONE, _SHARE = 1.0, 1e-3
"""Chi2, and part of it, that the states must promise for one more step of theirs or for new derivatives by them."""


class Problem:
    """One set on its way to the optimum: Levenberg-Marquardt on the parameters, the states by projection.

    Where the first guess is worse than the smaller set `below`, it begins from there instead, and is `resting` there
    before it does: a fit, for one round. A trial that is new in a part of the segments says in which, `only`, ``(S,)``,
    and `others` holds the residuals of the rest. Derivatives may come from a fit of another set near by, until they
    mislead. Its states too: segments that are far off in the beginning try the smoothed recording in their place. Of
    what is asked for the first is the point itself, its residuals may be `known`; the rest is for derivatives, which
    may be `lent` by a cheap simulation.
    """

    def __init__(
        self,
        shooting: Likelihood,
        effects: tuple[Effect, ...],
        values: tuple[Array, ...],
        starts: Array,
        hold: bool = False,
        near: Fit | None = None,
        smooth: Array | None = None,
        below: Fit | None = None,
    ) -> None:
        self.shooting, self.effects = shooting, effects
        self._smooth, self._below = smooth, inside(effects, values, below)
        self.resting: Fit | None = None
        self.derivatives = Derivatives(shooting, effects, values, near)
        self._trust = Trust(effects)
        self._trial = self._trust.inside(np.concatenate([np.zeros(0), *values]))
        self._trial_starts, self._predicted = starts.copy(), 0.0
        self.best: Point | None = None
        self._hold = hold or not len(self._trial)
        self._settling = 0 if self._hold or self.derivatives.design is None else SETTLE
        self._reach = shooting.state_reach()
        self._brakes, self._raw = Brakes(len(starts)), np.zeros(0)
        self.finished = self._smoothed = False
        self.only: NDArray[np.bool_] | None = None
        self.known: Array | None = None
        self.others: Array
        self._follower: Follower | None = None
        self._followers, self._patience = Followers(shooting, smooth), Patience()

    @property
    def chi2(self) -> float:
        """The least chi2 so far; that of the smaller set where it begins from there."""
        return min((point.chi2 for point in (self.best, self.resting) if point is not None), default=np.inf)

    @property
    def has_derivatives(self) -> bool:
        """Whether it may end here with its derivatives by the states."""
        return self.derivatives.design is not None and self._follower is None

    @property
    def lent(self) -> bool:
        """Whether derivatives may be lent by a cheap simulation."""
        return self.derivatives.lent

    @lent.setter
    def lent(self, lent: bool) -> None:
        self.derivatives.lent = lent

    @property
    def waits(self) -> bool:
        """Whether its states move alone, longer than those of others, or steps that promise most may yet keep that.

        A first one of which nothing is told, or the last one did in part: with the limit of a drive of six joints, 5 %
        off, a set left 105 thousand where others left 39; the first step, which promised 85, came to 82, the second
        would have come to 20, and the set was given up between.
        """
        if self._still:
            return self._followers.rescued and self._settling > 0
        return self._trust.untold and self._predicted > _MOST * self.chi2

    @property
    def _hopeful(self) -> bool:
        return self._predicted > _HOPE * self.chi2

    @property
    def _still(self) -> bool:
        return self._hold or self._settling > 0

    def ask(self) -> tuple[list[Candidate], Array]:
        """A trial alone, or what derivatives want where the last step has changed much, or both in the beginning."""
        flat, starts, self.known = self._trial, self._trial_starts, None
        if self._still:
            self.derivatives.hold()
        if self._follower is not None:
            self.only, self.others = self._follower.only, self._follower.residual
            return self._follower.ask()
        candidates, states = self.derivatives.ask(flat, starts, self._still)
        at = self.best
        if at is not None and flat is at.flat and starts is at.starts and len(candidates) > 1:
            self.known = self._raw
        return candidates, states

    def tell(self, white: Array, last: bool) -> None:
        """Takes the whitened residuals of what was asked for and makes the next trial."""
        if (follower := self._follower) is not None:
            follower.tell(white)
            if not follower.ends:
                return
            self._brakes.take(follower.chosen)
            self._trial_starts, self._follower, white = follower.point.starts, None, follower.residual[None]
        self.only, residual = None, white[0].copy()  # a view would keep all of what was asked for
        per_segment = chi2_of(residual)
        first, alone = self.best is None, self.best is not None and len(white) == 1
        if alone and self._still:
            self._each_for_itself(residual, per_segment, last)
        elif alone and self.derivatives.columns is not None and not total(per_segment) < self.chi2:
            self._worse(residual, per_segment, last)
        else:
            fresh = len(white) > 1 or self.derivatives.columns is None
            if fresh and self.derivatives.take(white, self._trial, self._still):
                self._brakes = Brakes(len(residual))
            self._better(residual, per_segment, len(white) > 1, last)
            if first and self._still and self._smooth is not None:
                far = self.shooting.segments.far_off(per_segment)
                self._trial_starts = np.where(far[:, None], self._smooth, self._trial_starts)
                self._smoothed = bool(far.any())
        self._settle(last)
        if self.finished and self.lent and not last and self.chi2 > _FAR * self.shooting.segments.samples.sum():
            self._anew()

    def _settle(self, last: bool) -> None:
        """First the states alone, so that what is not smooth does not refuse every step of the parameters."""
        if not self._settling:
            return
        assert self.best is not None
        little = self.derivatives.design is not None and self._predicted < _ALONE + _SHARE * self.chi2
        settled = (self.finished or little) and not self._smoothed
        better = self._below if self._below is not None and self.chi2 > self._below[0].chi2 else None
        soon = self.has_derivatives and not last and (settled or self._settling <= 2)
        if better is not None and soon and self._rescues(better[0]):
            return
        self._settling = 0 if last or settled else self._settling - 1
        self.finished, self._smoothed = self.finished and not self._settling, False
        if self._settling or last:
            return
        self.only, self._brakes = None, Brakes(len(self._trial_starts))
        self.finished = False
        self.derivatives.forget(states=self._followers.rescued and better is None)
        self._trust.begin()
        if better is not None:  # a first guess that makes it worse misleads
            below, self._trial = better
            self._trial_starts = below.starts
            self.derivatives.lend(below, self._trial)
            self.best, self._below, self.resting = None, None, resting(self.effects, self._trial, below)
            return
        self._trial, self._trial_starts = self.best.flat, self.best.starts
        if self.derivatives.take_lent(self._trial):
            self.derivatives.linearise(self._raw)
            self._propose()

    def _rescues(self, below: Fit) -> bool:
        """Whether the states of segments that are worse than by the smaller set are sought, once, for they are few."""
        assert self.best is not None
        found = self._followers.rescue(self._at(self._trial), self.best, self._raw, below.per_segment)
        if found is not None:
            self._follower, self.finished, self._settling = found, False, 1
        return found is not None

    def _better(self, residual: Array, per_segment: Array, fresh: bool, last: bool) -> None:
        """Takes a step that helped, or the point where the derivatives were taken."""
        old, chi2 = np.inf if self.best is None else self.best.chi2, total(per_segment)
        if chi2 <= old:
            self.best, self._raw = Point(self._trial, self._trial_starts, per_segment), residual
            if chi2 < old:
                self._followers.new_point()
        self.resting = None
        self.derivatives.linearise(residual)
        fell = old - chi2
        if not fresh and np.isfinite(old):
            self._trust.lengthen(much=fell > _KEPT * self._predicted)
            self.derivatives.age += 1
            self._patience.take(fell, self._predicted, chi2)
            braked = float(self.derivatives.linear.promise[self._brakes.on].sum()) > _HOPE * chi2
            held = braked and fell < 0.5 * self._predicted and not self._patience.ends
            if (fell > _MUCH * chi2 or held) and not last:  # far from where the derivatives were taken: once more, here
                self.derivatives.forget(states=fell > 0.5 * chi2 or held)
                return
            self.finished = fell < 1e-4 * chi2 + 0.05 or self._patience.ends
        self.finished |= last
        if not self.finished:
            self._propose()

    def _each_for_itself(self, residual: Array, per_segment: Array, last: bool) -> None:
        """Without free parameters every segment takes its own step, or a shorter one."""
        assert self.best is not None
        derivatives, old, old_starts = self.derivatives, self.best.per_segment, self.best.starts
        better = per_segment < old
        promised = derivatives.linear.promise[~better & self._brakes.on].sum()
        misled = derivatives.stale and promised > _ALONE + 0.1 * _SHARE * self.chi2
        self._raw = np.where(better[:, None], residual, self._raw)
        starts = np.where(better[:, None], self._trial_starts, old_starts)
        self.best = Point(self._trial, starts, np.minimum(per_segment, old))
        fell = float((old - self.best.per_segment).sum())
        derivatives.linearise(self._raw)
        halted = self._brakes.follow(better, (self._trial_starts != old_starts).any(axis=1))
        derivatives.age += 1
        self.finished = last or (fell < 1e-4 * self.chi2 + _LITTLE and halted)
        if not last and (misled or (fell > _MUCH * self.chi2 and derivatives.age > _STALE)):
            self._anew(misled)
        elif not self.finished:
            self._propose()
            shift = self._trial_starts - self.best.starts
            self.only = self._brakes.moving(derivatives.linear, shift, self.best.per_segment)
            self.others = self._raw
            self._trial_starts = np.where(self.only[:, None], self._trial_starts, self.best.starts)

    def _worse(self, residual: Array, per_segment: Array, last: bool) -> None:
        """A step that did not help: states that follow it better, then new derivatives, then a shorter step."""
        assert self.best is not None
        self.finished = last
        if last:
            return
        trial, shift = self._at(self._trial), functools.partial(self._shift, self._trial - self.best.flat)
        known = Point(self._trial, self._trial_starts, per_segment)
        self._follower = self._followers.behind(trial, known, residual, self.best, shift, self._hopeful)
        if self._follower is None:
            (self._anew if self.derivatives.age else self._shorten)()

    def _anew(self, misled: bool = True) -> None:
        """Goes on from the best point with new derivatives: precise ones where those that there were misled."""
        assert self.best is not None
        self._trial, self._trial_starts = self.best.flat, self.best.starts
        self.derivatives.forget(misled=misled)
        self.finished, self.only = False, None

    def _shorten(self) -> None:
        self.finished = self._trust.shorten(self._hopeful)
        if not self.finished:
            self._propose()

    def _propose(self) -> None:
        assert self.best is not None
        flat = self.best.flat
        delta = np.zeros(len(flat)) if self._still else self._trust.step(self.derivatives.linear, flat)
        shift = self._shift(delta)
        self._predicted = self.derivatives.linear.gain(delta[: self.derivatives.linear.normal.shape[-1]], shift)
        if self._predicted < 0.0 and delta.any():  # bounds have bent the step
            return self._shorten()
        self.finished |= self._predicted < _LITTLE + 1e-5 * self.chi2
        self._trial, self._trial_starts = flat + delta, self.best.starts + shift
        self._followers.new_trial()

    def _at(self, flat: Array) -> Candidate:
        return Candidate(self.effects, split(self.effects, flat))

    def _shift(self, delta: Array, damping: float = 0.0) -> Array:
        """The step of the initial states ``(S, n)`` beside one of the parameters, with so much damping at least."""
        held = np.maximum(self._brakes.damping, damping)
        return self.derivatives.linear.states(delta[: self.derivatives.linear.normal.shape[-1]], self._reach, held)

    def result(self) -> Fit:
        """The best point, or the smaller set where nothing was tried since it began from there."""
        if self.resting is not None:
            return self.resting
        best, by = self.best, self.derivatives
        assert best is not None
        whole = by.columns is not None and by.columns.shape[-1] == len(best.flat)
        derivatives = (by.design, by.columns, by.taken) if whole else (by.design,)
        normal, scores, values = by.linear.normal.sum(0), by.linear.gradient, split(self.effects, best.flat)
        if not self._hold and len(normal) < len(best.flat):  # it ended before the parameters moved
            normal, scores = np.zeros((len(best.flat),) * 2), np.zeros((len(scores), len(best.flat)))
        return Fit(self.effects, values, best.starts, best.chi2, best.per_segment, normal, scores, *derivatives)
