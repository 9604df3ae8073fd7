"""The sets that were compared, and the parts of the best one."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.outdone import is_outdone
from torch_activegp.diagnosis.shooting.chaining import borrowed
from torch_activegp.diagnosis.shooting.fit import Fit, inside, split
from torch_activegp.diagnosis.shooting.likelihood import ROUNDS, Shooting
from torch_activegp.diagnosis.shooting.race import Race
from torch_activegp.diagnosis.shooting.score import AT_LEAST, Score
from torch_activegp.physics.effect import Effect

_AS_MUCH = 0.005
"""Part of what the best set explains: a little less than what is worth a name."""
_REMEMBERED = 8
"""Sets whose derivatives are kept, with and without names for what seems tuned: two are developed at a time."""
_LIKELIER = 0.2
"""Score by which a set may be worse and comes first for a name that a modeller tunes, where something else is in it:
beside a cogging a rotor rather than another centre of mass that does the same."""
NEARLY = 0.05
"""Chi2 per degree of freedom by which a set is so close to a larger one that other initial states may be all between
them. Where nothing was missing, on a valve that sticks and slips, a stop gained 0.016 so."""
_ROUGHLY = 20
"""Rounds for the fit of a part of a set: where it is far off it creeps, and how far it is to some percent is enough."""
_STUCK = 1.0
"""Chi2 by which a fit may end above that of a set that it contains."""


@dataclasses.dataclass(frozen=True)
class Effort:
    """How far to fit some sets.

    Args:
        rounds: simulations at most, one after the other.
        work: time steps of all that was computed by then, :attr:`Shooting.work`, from which on none goes on.
        race: whether to give up on those that stay far behind.
    """

    rounds: int = ROUNDS
    work: float = np.inf
    race: bool = False


@dataclasses.dataclass
class Selection:
    """The sets that were fitted.

    Args:
        nominal: the fit without effects.
        fits: all fits, several of some sets among them.
        score: how they compare.
        cut_short: whether sets that could still have become the best were not developed.
        in_vain: whether none was, for a search on a part of the data had left much more than noise.
        beside: the set from whose initial states smaller ones were fitted last.
        parts: fits of parts of a set that were not compared, by the effects of the set and theirs.
        developed: sets on top of which others were fitted.
        simplified: chi2 of the best sets in place of which simpler ones were tried, and the scores that these had.
        swapped: the set in place of whose effects others were tried, all of them, in this search.
        tunable: all effects that a modeller may have tuned.
        tunable_gains: what each of these gains on top of the nominal, and all together, to first order; None until
            they are asked for.
        of_a_step: effects of the best set that other time steps do without, :mod:`.finer_steps`, or forces held over
            them, :mod:`.held_forces`.
        held: sets with a static friction whose numbers are held, :mod:`.static_friction`.
    """

    nominal: Fit
    fits: list[Fit]
    score: Score
    cut_short: bool = False
    in_vain: bool = False
    beside: Fit | None = None
    parts: dict[tuple[frozenset[Effect], frozenset[Effect]], Fit] = dataclasses.field(default_factory=dict)
    developed: set[frozenset[Effect]] = dataclasses.field(default_factory=set)
    simplified: set[tuple[float, Score]] = dataclasses.field(default_factory=set)
    swapped: frozenset[Effect] = frozenset()
    tunable: tuple[Effect, ...] = ()
    tunable_gains: tuple[dict[Effect, float], float] | None = None
    of_a_step: frozenset[Effect] = frozenset()
    held: Sequence[Fit] = ()

    @property
    def best(self) -> Fit:
        """The set with the best score that a machine can have, and that none outdoes."""
        return next(self._in_order())

    def _in_order(self) -> Iterator[Fit]:
        """What a machine can have and none outdoes, best first."""
        ordered = sorted((fit for fit in self.fits if fit.plausible), key=self._order)
        return (fit for fit in ordered if not is_outdone(fit, ordered, self.score))

    def _order(self, fit: Fit) -> float:
        """The score; of sets that nothing tells apart, the one with more of what a modeller tunes comes first."""
        tunable = sum(effect.tunable and effect.key not in self.score.free for effect in fit.effects)
        return self.score(fit) - (_LIKELIER * tunable if tunable < len(fit.effects) else 0.0)

    def add(self, fits: Sequence[Fit]) -> list[Fit]:
        """Takes further fits in, and returns those that did not fail."""
        sound = [fit for fit in fits if np.isfinite(fit.chi2)]
        self.fits += sound
        return sound

    def forget_parts(self) -> None:
        """Forgets what was fitted beside the sets, and gains on top of the nominal: these or the likelihood changed."""
        self.parts, self.tunable_gains = {}, None

    def lighten(self) -> None:
        """Forgets derivatives of all fits but the nominal and the best few: large arrays, of use to develop a set."""
        named = dataclasses.replace(self, score=self.score.without_free())
        kept = [self.nominal, *self.ranked()[:_REMEMBERED], *named.ranked()[:_REMEMBERED]]
        self.fits = [fit if fit in kept else fit.without_derivatives for fit in self.fits]

    def ranked(self) -> list[Fit]:
        """Best first, one fit for each set of names and targets, without those that another one outdoes."""
        seen: dict[frozenset[tuple[str, str]], Fit] = {}
        for fit in self._in_order():
            seen.setdefault(fit.keys, fit)
        return list(seen.values())

    def of(self, effects: Sequence[Effect]) -> Fit | None:
        """The best fit of a set, or None where it was not fitted."""
        same = [fit for fit in self.fits if frozenset(fit.effects) == frozenset(effects)]
        return min(same, key=lambda fit: fit.chi2, default=None)

    def below(self, effects: Sequence[Effect]) -> Fit:
        """The best fit of what some effects hold, the nominal at least."""
        held = set(effects)
        return min((fit for fit in (self.nominal, *self.fits) if set(fit.effects) < held), key=lambda fit: fit.chi2)

    def was_simplified(self) -> bool:
        """Whether this is asked once more of the same best set and score."""
        now = self.best.chi2, self.score
        known = now in self.simplified
        self.simplified.add(now)
        return known

    def within(self, fit: Fit) -> Fit | None:
        """The best fit of a smaller set, where that fits better, or as well as one at rest; else None.

        Then the larger one got stuck, or was given up.
        """
        effects = set(fit.effects)
        smaller = [other for other in (self.nominal, *self.fits) if set(other.effects) < effects]
        best = min(smaller, key=lambda other: other.chi2, default=None)
        stuck = best is not None and (fit.at_rest or not fit.chi2 <= best.chi2 + _STUCK)
        return best if stuck else None

    def may_pay(self, fit: Fit, dof: int) -> bool:
        """Whether a fit leaves so much more than noise that one more name could be worth its price.

        Nothing is said of the nominal: the floor may be too high, and what it leaves is seen behind the effects alone.
        """
        return (
            not fit.effects
            or bool(self.score.free)
            or fit.chi2 - AT_LEAST * dof > self.score.scale * self.score.cheapest
        )

    def needs_more_than(self, names: int) -> bool:
        """Whether no set of so many effects explains about as much as the best one does, for its parameters."""
        small = (fit for fit in self.fits if fit.plausible and len(fit.effects) <= names)
        few = min(small, key=lambda fit: fit.chi2, default=self.nominal)
        lost, more = few.chi2 - self.best.chi2, self.best.size - few.size
        worth = self.score.scale * self.score.a_parameter * max(more, 0)
        return lost > max(_AS_MUCH * (self.nominal.chi2 - self.best.chi2), worth)

    @property
    def dominated(self) -> bool:
        """Whether a set of fewer effects and fewer parameters fits better than the best one, by more than chance."""
        best = self.best
        better = (fit for fit in self.fits if fit.chi2 < best.chi2 - _STUCK and fit.plausible)
        return any(len(fit.effects) < len(best.effects) and fit.size < best.size for fit in better)

    def rescale(self, dof: int) -> None:
        """The noise is what the best fit leaves, and never less than the noise model says."""
        left = min(fit.chi2 / max(dof - fit.size, 1) for fit in self.fits if fit.plausible)
        self.score = self.score.seeing(left, self.nominal.chi2, dof)

    def without(self, key: tuple[str, str], dof: int) -> Selection:
        """The same without the sets that hold a name at a target, by the noise that the others leave."""
        fewer = dataclasses.replace(self, fits=[fit for fit in self.fits if key not in fit.keys])
        fewer.rescale(dof)
        return fewer

    def may_become_best(self, fit: Fit, dof: int) -> bool:
        """Whether a set that got stuck could do better than the best one, if it left noise alone."""
        return bool(self.score.free) or self.score.may_beat(fit.effects, self.best.effects, self.best.chi2, dof)


def compare(
    shooting: Shooting,
    selection: Selection,
    sets: Sequence[tuple[Sequence[Effect], Sequence[Array]]],
    near: Fit,
    effort: Effort = Effort(),
    below: Fit | Sequence[Fit] | None = None,
    starts: Array | None = None,
) -> None:
    """Fits some sets from the states of a fit near by, and takes them in.

    What ends worse than a set that it contains and that might be the best is fitted once more from there: fits of
    friction that sticks depend on where they begin. What was given up at rest is not, until somebody asks for it.

    Args:
        shooting: the likelihood.
        selection: takes them in.
        sets: effects and first guesses.
        near: a fit near by.
        effort: how far to fit them.
        below: a fit of what the sets have in common, if they have, or one for each of what is in it.
        starts: initial states to begin from, one for each set, ``(N, S, nq + nv)``, where not those of the fit near by.
    """
    if sets:
        race = Race(selection.score, selection.nominal.chi2, shooting.dof) if effort.race else None
        begin = near.starts if starts is None else starts
        fits = shooting.fit(sets, begin, effort.rounds, race, near=near, below=below, work=effort.work)
        selection.add(fits)
        selection.rescale(shooting.dof)
        far = selection.score(selection.best) + selection.score.slack
        tried = {frozenset(fit.effects): selection.of(fit.effects) or fit for fit in fits}  # the best of each set
        hopes = (fit for fit in tried.values() if selection.may_become_best(fit, shooting.dof))
        stuck = [fit for fit in hopes if not fit.at_rest and shooting.work < effort.work]
        selection.add([better for fit in stuck if (better := _from_within(shooting, selection, fit, far)) is not None])
    selection.rescale(shooting.dof)
    selection.lighten()


def _from_within(shooting: Shooting, selection: Selection, fit: Fit, far: float = np.inf) -> Fit | None:
    """A fit once more from the best one that it contains, where it ended worse; None where it did not.

    Args:
        shooting: the likelihood.
        selection: what was compared.
        fit: to look at.
        far: the score from which on what it contains is not worth the time.
    """
    smaller = selection.within(fit)
    if smaller is None or selection.score(smaller) > far:
        return None
    begin = inside(fit.effects, fit.values, smaller)
    if begin is None:
        return None
    return shooting.fit([(fit.effects, split(fit.effects, begin[1]))], smaller.starts, near=smaller)[0]


def fitted(shooting: Shooting, selection: Selection, effects: Sequence[Effect], whole: Fit | None = None) -> Fit:
    """The fit of a part of a set, the best one unless said, which may have been compared or asked for already.

    One that fits worse than what it contains was given up in a race, or got stuck, and is fitted from there.
    """
    best = whole or selection.best
    place = frozenset(best.effects), frozenset(effects)
    found = [fit for fit in (selection.of(effects), selection.parts.get(place)) if fit is not None]
    if not found:
        smaller = selection.below(effects) if effects else None
        found = shooting.fit([best.part(effects)], best.starts, _ROUGHLY, near=best, below=smaller)
    if place not in selection.parts:
        near = found[0].chi2 - best.chi2 < NEARLY * shooting.dof
        again = borrowed(shooting, found[0], best) if near else _from_within(shooting, selection, found[0])
        found += [] if again is None else [again]
    selection.parts[place] = min(found, key=lambda fit: fit.chi2)
    return selection.parts[place]


def without_each(
    selection: Selection, shooting: Shooting, named: Sequence[Effect], work: float = np.inf
) -> list[tuple[Effect, Fit]]:
    """The best set without each of some of its effects; fits end where so much is computed in all."""
    best = selection.best
    rests = {effect: [e for e in best.effects if e is not effect] for effect in named}
    unknown = [rest for rest in rests.values() if selection.of(rest) is None]
    if unknown:
        sets = [best.part(rest) for rest in unknown]
        selection.add(shooting.fit(sets, best.starts, near=best, below=selection.nominal, work=work))
    smaller = []
    for effect, rest in rests.items():
        fit = selection.of(rest)
        again = fitted(shooting, selection, rest, best)
        if again is fit or selection.add([again]):
            smaller.append((effect, again))
    return smaller


def in_place(best: Fit, other: Fit, beside: frozenset[tuple[str, str]] = frozenset()) -> tuple[Effect, Effect] | None:
    """The effect of a set, and the one in its place in another that is the same else; None where more is different.

    Args:
        best: the set.
        other: the other one.
        beside: names and targets that either may have or not.
    """
    mine, others = ({effect for effect in fit.effects if effect.key not in beside} for fit in (best, other))
    old, new = mine - others, others - mine
    return (old.pop(), new.pop()) if len(old) == len(new) == 1 else None
