"""Chooses the set of effects: forward with a beam, refitted, and backward, by an extended BIC."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from torch_activegp.diagnosis.compared import Selection, compare, fitted
from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.heats import CLOSE, heat, seen_on
from torch_activegp.diagnosis.proposals import (
    MOST,
    Set,
    also_from,
    companies,
    diverse,
    join,
    richer,
    simpler,
    with_values,
    without_weak,
)
from torch_activegp.diagnosis.prospects import cannot_win, hopeless, is_alike
from torch_activegp.diagnosis.repeated import repeated
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.score import Score
from torch_activegp.diagnosis.screening import Atom, Screen, allowed, screen
from torch_activegp.diagnosis.shooting import Shooting
from torch_activegp.diagnosis.stand_ins import forms_of_parts, soften, swap, try_tuned, undo
from torch_activegp.diagnosis.tuning import beside, only_undoes, undone
from torch_activegp.physics.effect import Effect

BEAM = 2
SWAPS = 2
MAX_EFFECTS = 4
_CHEAP = 60
"""So many fits of one segment cost little: where there are few segments, more is fitted than looks best."""
_COMPANY = 40
_ROUNDS = 20
_PATIENCE = 15e6
"""Cases that end right compute a few million time steps for a search, most of them below ten. What no effect on the
list explains would compute ever more."""
_MORE = 20.0
_AS_WELL = 10.0
"""By so much, in units of what is left and with the price of its parameters, a tuning undone may be worse than a name
that stands for it."""
_LITTLE, _SOME = 0.05, 1.0
"""Per degree of freedom. Where nothing was missing, on a valve that sticks and slips, a stop gained 0.016 so;
for the nominal the bar is higher: on a machine that strikes, at 50 Hz, a friction seemed to gain 0.5."""


class Depth(NamedTuple):
    """How far to search.

    Args:
        rounds: how often the best sets are developed.
        swaps: how often others are tried in place of each effect.
        work: time steps to compute before no further set is developed.
    """

    rounds: int = 2 * MAX_EFFECTS
    swaps: int = SWAPS
    work: float = _PATIENCE

    def counted_from(self, work: float) -> Depth:
        """The same with its work on top of some that is done."""
        return self._replace(work=work + self.work)


def select(
    shooting: Shooting,
    effects: Sequence[Effect],
    nominal: Fit,
    sets: Sequence[tuple[Sequence[Effect], Sequence[Array]]] = (),
    first: Fit | None = None,
    tell: Callable[[str], None] = lambda _: None,
    free: frozenset[tuple[str, str]] = frozenset(),
    depth: Depth | None = None,
) -> Selection:
    """Chooses effects that explain the residuals.

    Args:
        shooting: the likelihood.
        effects: what is tried.
        nominal: the fit without effects.
        sets: to begin from besides the nominal, with first guesses.
        first: a fit by this likelihood to begin from; it is compared as it is, and the sets begin from its states.
        tell: hears what is being done.
        free: what seemed to be tuned already, :attr:`Score.free`.
        depth: of the search; to its end where there is none.
    """
    depth = (depth or Depth()).counted_from(shooting.work)
    names = len({effect.key for effect in effects})
    hides_colour = shooting.hides_colour and not shooting.noise.colour.any()
    score = Score(shooting.samples, names, 1.0, free=free, hides_colour=hides_colour)
    selection = Selection(nominal, [nominal], score)
    near = first if first is not None and np.isfinite(first.chi2) else nominal
    if sets or near.effects:
        selection.add([near] if near.effects else [])
        selection.add(shooting.fit(sets, near.starts, near=near))
        selection.rescale(shooting.dof)
    expanded: set[frozenset[Effect]] = set()
    search(selection, shooting, effects, expanded, tell, depth)
    found = selection.best
    if not selection.cut_short:
        try_tuned(selection, shooting, effects)
    tuned = not selection.score.free and _seems_tuned(selection, shooting, effects)
    if tuned:
        undo(selection, shooting, effects)
    if tuned or selection.best is not found:
        _simplify(selection, shooting, effects)
        search(selection, shooting, effects, expanded, tell, depth)
    if selection.score.free and not _only_undoes(selection, shooting):
        selection.score = dataclasses.replace(selection.score, free=frozenset())
        search(selection, shooting, effects, expanded, tell, depth)
    return selection


def search(
    selection: Selection,
    shooting: Shooting,
    effects: Sequence[Effect],
    expanded: set[frozenset[Effect]],
    tell: Callable[[str], None],
    depth: Depth,
) -> None:
    """Develops the best sets until none is left that could become the best."""
    resorts = _resorts(selection, shooting, effects, tell, depth.swaps)
    skipped: set[frozenset[Effect]] = set()
    for _ in range(depth.rounds):
        _be_fair(selection, shooting)
        if shooting.work > depth.work:
            selection.cut_short = True
            _simplify(selection, shooting, effects)  # what came last in place of an effect too
            break
        known = expanded | skipped
        fresh = (f for f in selection.ranked() if frozenset(f.effects) not in known)
        beam = [f for f in fresh if not is_alike(selection, f, expanded)]
        beam = [f for f in beam[:BEAM] if selection.score(f) <= selection.score(selection.best) + selection.score.slack]
        if not beam and frozenset() not in expanded and hopeless(selection, shooting):
            beam = [selection.nominal]  # what was found on a part of the data led astray: from the beginning, on all
        if not beam:
            if not next(resorts, False):
                break
            continue
        for fit in itertools.takewhile(lambda _: shooting.work <= depth.work, beam):
            if not _is_promising(selection, shooting, fit, expanded):
                skipped.add(frozenset(fit.effects))
                continue
            expanded.add(frozenset(fit.effects))
            tell(f"testing what comes on top of {len(fit.effects)} effect{'s' * (len(fit.effects) != 1)}")
            _expand(selection, shooting, effects, fit, depth.work + _PATIENCE)
        _simplify(selection, shooting, effects)
        selection.rescale(shooting.dof)


def _is_promising(selection: Selection, shooting: Shooting, fit: Fit, expanded: set[frozenset[Effect]]) -> bool:
    """Whether one more name may come on top of a set, and make it the best."""
    lost = bool(fit.effects) and hopeless(selection, shooting, least=2)
    room = selection.score.names_in(fit.effects) < MAX_EFFECTS and selection.may_pay(fit, shooting.dof)
    return room and not lost and not cannot_win(selection, fit, expanded)


def _resorts(
    selection: Selection, shooting: Shooting, effects: Sequence[Effect], tell: Callable[[str], None], swaps: int
) -> Iterator[bool]:
    """What is tried where no set is left to develop, one at a time."""
    if selection.score.inadequate and soften(selection, shooting, effects):
        yield True
    swapped: frozenset[Effect] = frozenset()
    for _ in range(swaps):
        if frozenset(selection.best.effects) == swapped or hopeless(selection, shooting):
            break
        swapped = frozenset(selection.best.effects)
        tell("testing what could stand in place of each effect")
        swap(selection, shooting, effects)
        yield True


def _seems_tuned(selection: Selection, shooting: Shooting, effects: Sequence[Effect]) -> bool:
    """Whether what is tunable in the best set only undoes a tuning; then nothing that is tunable costs a name.

    Where the best set has nothing tunable, the one that would be the best if that cost no name must fit as well.
    """
    named, found = selection.score, selection.best
    selection.score = dataclasses.replace(named, free=frozenset(e.key for e in effects if e.tunable))
    best = selection.best
    more = named.a_parameter * (best.size - found.size) - _AS_WELL
    fits = best.chi2 + named.scale * more < found.chi2 or any(effect.tunable for effect in found.effects)
    if not fits or not any(effect.tunable for effect in best.effects) or not _only_undoes(selection, shooting):
        selection.score = named
    return bool(selection.score.free)


def _only_undoes(selection: Selection, shooting: Shooting) -> bool:
    """Whether what seems to be tuned is no more than that in the best set, and no smaller set fits better."""
    best, free = selection.best, selection.score.free
    tunable = [e for e in best.effects if e.key in free]
    others = [e for e in best.effects if e.key not in free]
    if not tunable or not others:
        return bool(others)
    if selection.dominated:
        return False
    alone, without = (fitted(shooting, selection, some) for some in (tunable, others))
    return only_undoes(selection.nominal, alone, without, best, selection.needs_more_than(MAX_EFFECTS))


def _expand(
    selection: Selection, shooting: Shooting, effects: Sequence[Effect], fit: Fit, work: float = np.inf
) -> None:
    """Fits the most promising sets that contain a fit and something more; these end where so much is computed in all.

    As much again as a whole search may: where joints stick, 18 sets around nothing took 60 million time steps.
    """
    part, here = seen_on(shooting, fit, selection.score)
    screened = screen(part, here, allowed(effects, fit)).times(shooting.segments.size / part.segments.size)
    most = max(MOST, _CHEAP // shooting.segments.size)
    proposed = [*_proposals(selection, fit, screened, most), *richer(fit, effects)]
    if selection.score.names_in(fit.effects) < len(fit.effects):
        proposed += undone(fit, screened, selection.score.a_parameter * selection.score.scale)
    known = {frozenset(f.effects) for f in selection.fits}
    fresh = heat(shooting, [p for p in proposed if frozenset(p[0]) not in known], fit, selection.score)
    compare(shooting, selection, fresh.sets, fit, race=work, below=fit, starts=fresh.starts)


def _be_fair(selection: Selection, shooting: Shooting) -> None:
    """Fits the nominal, and the best set without each name, once more from its states where it gains little on them.

    Other states may be all that gains: on a joint that sticks, or on the other side of an impact.
    """
    best, nominal = selection.best, selection.nominal
    if not best.effects or best is selection.beside:
        return
    selection.beside = best
    parts = [(), *(tuple(e for e in best.effects if e is not one) for one in best.effects if len(best.effects) > 1)]
    known = [nominal if not part else selection.of(part) for part in parts]
    values = best.by_effect
    sets = [
        (part, tuple(values[effect] for effect in part))
        for part, fit in zip(parts, known, strict=True)
        if fit is not None and fit.chi2 - best.chi2 < (_LITTLE if part else _SOME) * shooting.dof
    ]
    again = shooting.fit(sets, best.starts, near=best)
    selection.add([fit for fit in again if fit.effects])
    bare = next((fit for fit in again if not fit.effects), nominal)
    if bare.chi2 < nominal.chi2:
        selection.nominal, selection.fits = bare, [bare if fit is nominal else fit for fit in selection.fits]
    if again:
        selection.rescale(shooting.dof)


def _proposals(selection: Selection, fit: Fit, screened: Screen, most: int) -> list[Set]:
    """The most promising sets that contain one more effect, or several where these help together."""

    def worth(score: Score, atoms: tuple[Atom, ...]) -> float:
        gain = screened.joint_gain(atoms) if len(atoms) > 1 else atoms[0].gain
        return gain / score.scale - score.price([a.effect for a in atoms])

    best = screened.best()
    singles = [a for a in best[: 4 * most] if worth(selection.score, (a,)) > 0.0]
    singles.sort(key=lambda a: -worth(selection.score, (a,)))
    chosen: list[Sequence[Atom]] = [(a,) for a in diverse(singles, most)]
    lenient = functools.cache(functools.partial(worth, selection.score.before_any_fit(selection.nominal)))
    together = companies(best[:_COMPANY], lenient, MAX_EFFECTS - selection.score.names_in(fit.effects), _MORE)
    together += repeated(fit, screened, lenient, _MORE)
    chosen += [with_values(company, screened.together(company)[1]) for company in together]
    if not fit.effects:
        gains = [screened.joint_gain(company) for company in together]
        alone = max((a.gain for a in singles), default=0.0)
        hidden = beside(screened, selection.score.a_parameter, alone, max([alone, *gains]))
        if hidden:
            free = frozenset(atom.effect.key for atom in screened.atoms if atom.effect.tunable)
            selection.score = dataclasses.replace(selection.score, free=free)
        chosen += hidden
    return [join(fit, some) for atoms in chosen for some in also_from(atoms)]


def _simplify(selection: Selection, shooting: Shooting, effects: Sequence[Effect]) -> None:
    """Tries the best set without each of its effects, and with simpler laws or other forms in their place."""
    best = selection.best
    known: dict[frozenset[Effect], float] = {}
    for fit in selection.fits:
        known[frozenset(fit.effects)] = min(fit.chi2, known.get(frozenset(fit.effects), np.inf))
    score = selection.score
    sets = simpler(best, effects, known, best.chi2 + CLOSE * score.scale, score.free)
    fewer = without_weak(best, lambda effect: score.scale * score.price([effect]))
    sets += [fewer] if fewer and frozenset(fewer[0]) not in known else []
    for some in (sets, forms_of_parts(selection, effects, known)):  # each among its like: these begin far off
        passed = heat(shooting, some, best, score)
        compare(shooting, selection, passed.sets, best, rounds=_ROUNDS, starts=passed.starts)
