"""Chooses the set of effects: forward with a beam, refitted, and backward, by an extended BIC."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.cut_short import try_in_place
from torch_activegp.diagnosis.selection.development import be_fair, expand, refine, simplify
from torch_activegp.diagnosis.selection.prospects import MAX_EFFECTS, cannot_win, hopeless, is_alike
from torch_activegp.diagnosis.selection.stand_ins import soften, swap, try_tuned, undo
from torch_activegp.diagnosis.selection.stepwise import one_by_one
from torch_activegp.diagnosis.selection.tuning import is_a_tuning
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE, Score
from torch_activegp.physics.effect import Effect

BEAM = 2
SWAPS = 2
_PATIENCE = 15e6
"""Cases that end right compute a few million time steps for a search, most of them below ten. What no effect on the
list explains would compute ever more."""
_MORE = 5e6
"""And so many more for what could come in place of what was found."""
_AS_WELL = 10.0
"""By so much, in units of what is left and with the price of its parameters, a tuning undone may be worse than a name
that stands for it."""

Seen = set[frozenset[Effect]]


@dataclasses.dataclass(frozen=True)
class Depth:
    """How far to search.

    Args:
        rounds: how often the best sets are developed; 0 fits those that it begins from, and searches no further.
        swaps: how often others are tried in place of each effect.
        work: time steps to compute before no further set is developed.
        stepwise: whether names are tried one after another where several came together.
        more: time steps on top, by which sets end that were begun before.
    """

    rounds: int = 2 * MAX_EFFECTS
    swaps: int = SWAPS
    work: float = _PATIENCE
    stepwise: bool = True
    more: float = _PATIENCE

    @property
    def aside(self) -> float:
        """Time steps on top for rivals of what was found, and for what is simpler."""
        return min(self.more, _MORE)

    def counted_from(self, work: float) -> Depth:
        """The same with its work on top of some that is done."""
        return dataclasses.replace(self, work=work + self.work)


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
    selection = Selection(nominal, [nominal], score, tunable=tuple(e for e in effects if e.tunable))
    near = first if first is not None and np.isfinite(first.chi2) else nominal
    if sets or near.effects:
        selection.add([near] if near.effects else [])
        selection.add(shooting.fit(sets, near.starts, near=near, work=depth.work + depth.more))
        selection.rescale(shooting.dof)
    if not depth.rounds:
        selection.cut_short = selection.in_vain = True
        return selection
    return go_on(selection, shooting, effects, tell, depth)


def go_on(
    selection: Selection,
    shooting: Shooting,
    effects: Sequence[Effect],
    tell: Callable[[str], None],
    depth: Depth,
) -> Selection:
    """Searches further, in place, from what was compared by the same likelihood; see :func:`select`.

    Work is counted already (:meth:`Depth.counted_from`).
    """
    selection.cut_short = selection.in_vain = False
    search(selection, shooting, effects, tell, depth)
    found, goes_on = selection.best, not selection.cut_short and shooting.work <= depth.work
    if goes_on:
        try_tuned(selection, shooting, effects)
    tuned = not selection.score.free and _seems_tuned(selection, shooting, effects)
    if tuned and goes_on:
        undo(selection, shooting, effects)
    if (tuned or selection.best is not found) and not selection.cut_short:
        _simplify(selection, shooting, effects, depth)
        search(selection, shooting, effects, tell, depth)
    if selection.score.free and not _only_undoes(selection, shooting):
        selection.score = selection.score.without_free()
        search(selection, shooting, effects, tell, depth)
    if selection.cut_short and depth.swaps:
        tell("testing what could stand in place of each effect")
        try_in_place(selection, shooting, effects, shooting.work + _MORE)
    return selection


def search(
    selection: Selection,
    shooting: Shooting,
    effects: Sequence[Effect],
    tell: Callable[[str], None],
    depth: Depth,
) -> None:
    """Develops the best sets until none is left that could become the best."""

    def develop(fit: Fit) -> None:
        selection.developed.add(frozenset(fit.effects))
        tell(f"testing what comes on top of {len(fit.effects)} effect{'s' * (len(fit.effects) != 1)}")
        expand(selection, shooting, effects, fit, depth.work + depth.more)

    def may_go_on(fit: Fit) -> bool:
        return shooting.work <= depth.work and _is_promising(selection, shooting, fit, skipped)

    def step_by_step(least: int = 1) -> bool:
        return depth.stepwise and one_by_one(selection, shooting, develop, may_go_on, least)

    selection.swapped = frozenset()
    resorts = _resorts(selection, shooting, effects, tell, depth, step_by_step)
    skipped: Seen = set()
    for _ in _rounds(selection, shooting, effects, depth, skipped):
        beam = _beam(selection, shooting, skipped)
        if not beam and not next(resorts, False):
            break
        for fit in filter(may_go_on, beam):
            develop(fit)
        if beam:
            step_by_step(least=BEAM + 1)
            _simplify(selection, shooting, effects, depth)


def _simplify(selection: Selection, shooting: Shooting, effects: Sequence[Effect], depth: Depth) -> None:
    """Simplifies what was found, by as much work at least as rivals of it may take, however little is left.

    On a drive (EMPS) a search that had none left named Stribeck's friction in place of dry friction.
    """
    simplify(selection, shooting, effects, max(depth.work, shooting.work) + depth.aside)


def _rounds(
    selection: Selection, shooting: Shooting, effects: Sequence[Effect], depth: Depth, skipped: Seen
) -> Iterator[int]:
    """Rounds of a search, each with a best set that was compared fairly, as long as there is work left."""
    for number in range(depth.rounds):
        be_fair(selection, shooting)
        if shooting.work > depth.work:
            _simplify(selection, shooting, effects, depth)  # what came last in place of an effect too
            selection.cut_short = not _is_complete(selection, shooting, skipped)
            return
        yield number


def _is_complete(selection: Selection, shooting: Shooting, skipped: Seen) -> bool:
    """Whether nothing would be tried any more: noise alone is left, and what could stand in place of each effect was.

    A weak spring behind filtered noise was found at once, its rivals took the rest of the work, and a search that had
    found all that there was to find was called cut short: `unknown`.
    """
    best, seen = selection.best, set(skipped)
    alone = best.chi2 < NOISE_ALONE * shooting.dof and selection.swapped == frozenset(best.effects)
    return alone and not any(_is_promising(selection, shooting, fit, seen) for fit in _beam(selection, shooting, seen))


def _beam(selection: Selection, shooting: Shooting, skipped: Seen) -> list[Fit]:
    """The best sets that were not developed yet; the nominal, where what was found on a part of the data led astray."""
    known, score = selection.developed | skipped, selection.score
    beam: list[Fit] = []
    for fit in selection.ranked():
        if len(beam) == BEAM or score(fit) > score(selection.best) + score.slack:
            break
        others = selection.developed | {frozenset(other.effects) for other in beam}
        if frozenset(fit.effects) not in known and not is_alike(selection, fit, others):
            beam.append(fit)
    astray = not beam and frozenset() not in selection.developed and hopeless(selection, shooting)
    return [selection.nominal] if astray else beam


def _is_promising(selection: Selection, shooting: Shooting, fit: Fit, skipped: Seen) -> bool:
    """Whether one more name may come on top of a set, and make it the best; else the set is skipped from now on."""
    lost = bool(fit.effects) and hopeless(selection, shooting, least=2)
    room = selection.score.names_in(fit.effects) < MAX_EFFECTS and selection.may_pay(fit, shooting.dof)
    promising = room and not lost and not cannot_win(selection, fit)
    if not promising:
        skipped.add(frozenset(fit.effects))
    return promising


def _resorts(
    selection: Selection,
    shooting: Shooting,
    effects: Sequence[Effect],
    tell: Callable[[str], None],
    depth: Depth,
    step_by_step: Callable[[], bool],
) -> Iterator[bool]:
    """What is tried where no set is left to develop, one at a time."""
    if selection.score.inadequate and soften(selection, shooting, effects):
        yield True
    if refine(selection, shooting, effects, depth.work + depth.aside):
        yield True
    yield from _swapped(selection, shooting, effects, tell, depth)
    if step_by_step():
        _simplify(selection, shooting, effects, depth)
        yield True
        yield from _swapped(selection, shooting, effects, tell, depth)


def _swapped(
    selection: Selection, shooting: Shooting, effects: Sequence[Effect], tell: Callable[[str], None], depth: Depth
) -> Iterator[bool]:
    """Others in place of each effect of the best set, so often at most, as long as another set becomes the best."""
    begun: frozenset[Effect] = frozenset()
    end = depth.work + depth.aside
    for _ in range(depth.swaps):
        if frozenset(selection.best.effects) == begun or hopeless(selection, shooting):
            break
        begun = frozenset(selection.best.effects)
        tell("testing what could stand in place of each effect")
        swap(selection, shooting, effects, end)
        selection.swapped = begun if shooting.work <= end else frozenset()
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
    return is_a_tuning(shooting, selection, tunable, others, selection.needs_more_than(MAX_EFFECTS))
