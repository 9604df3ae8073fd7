"""Develops a set: what comes on top of it, what is simpler, and what other initial states alone would gain."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.selection.compared import NEARLY, Effort, Selection, compare
from torch_activegp.diagnosis.selection.heats import CLOSE, heat, seen_on
from torch_activegp.diagnosis.selection.impacts import behind_impacts
from torch_activegp.diagnosis.selection.more_axes import in_more_axes
from torch_activegp.diagnosis.selection.proposals import (
    MOST,
    Set,
    also_from,
    companies,
    diverse,
    holds_simpler_law,
    join,
    richer,
    simpler,
    with_another_past,
    with_values,
    without_weak,
)
from torch_activegp.diagnosis.selection.prospects import MAX_EFFECTS
from torch_activegp.diagnosis.selection.repeated import repeated
from torch_activegp.diagnosis.selection.screening import Atom, Screen, allowed, screen
from torch_activegp.diagnosis.selection.stand_ins import forms_of_parts, without_needless_bristles
from torch_activegp.diagnosis.selection.tuning import beside, undone
from torch_activegp.diagnosis.shooting.chaining import borrowed
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.effect import Effect

_CHEAP = 60
"""So many fits of one segment cost little: where there are few segments, more is fitted than looks best."""
_COMPANY = 40
_A_FIT, _NO_END = 20.0, 1e6
"""Simulations of all segments that the fit of a set takes at least; and fits that are without end."""
_FIRST = 3
"""So many simpler sets, and other forms, are fitted in any case: 17, behind a backlash on an arm of two joints, took
40 s in short time steps."""
_ROUNDS, _GLANCE = 20, 5
_FEW = 0.1
"""Part of the segments, and rounds for the states alone, in which a fit shows that it is led astray."""
_MORE = 20.0
_SOME = 1.0
"""`NEARLY` for the nominal: on a machine that strikes, at 50 Hz, a friction seemed to gain 0.5."""


def expand(selection: Selection, shooting: Shooting, effects: Sequence[Effect], fit: Fit, work: float = np.inf) -> None:
    """Fits the most promising sets that contain a fit and something more; these end where so much is computed in all.

    As much again as a whole search may: where joints stick, 18 sets around nothing took 60 million time steps. No more
    are begun than end by then, the first of them: 54 with stops and plays, on an arm in steps of 0.5 ms, took as many
    for 4 million that they should have taken.
    """
    part, here = seen_on(shooting, fit, selection.score)
    screened = screen(part, here, allowed(effects, fit)).times(shooting.segments.size / part.segments.size)
    most = max(MOST, _CHEAP // shooting.segments.size)
    known = {frozenset(f.effects) for f in selection.fits}

    def new(sets: Sequence[Set]) -> list[Set]:
        return [some for some in sets if frozenset(some[0]) not in known]

    begun = new(_proposals(selection, fit, screened, effects, most))
    begun = [*begun[: max(MOST, _room(part, work - shooting.work))], *new(richer(fit, effects))]
    if selection.score.names_in(fit.effects) < len(fit.effects):
        begun += new(undone(fit, screened, selection.score.a_parameter * selection.score.scale))
    fresh = heat(shooting, begun, fit, selection.score, work)
    compare(shooting, selection, fresh.sets, fit, Effort(work=work, race=True), below=fit, starts=fresh.starts)
    behind_impacts(selection, shooting, [frozenset(effects) for effects, _ in fresh.sets], work)


def simplify(selection: Selection, shooting: Shooting, effects: Sequence[Effect], work: float = np.inf) -> None:
    """Tries the best set without each of its effects, and with simpler laws or other forms in their place.

    Other forms of parts, and of what remembers, come last, for what is left then: beside three other names, of which
    two were there, the eight forms of a backlash took a minute on a slide, and then the backlash itself went. These
    fits end too where so much is computed in all: 24 forms of two payloads at 500 Hz took 50 million time steps.
    """
    best = selection.best
    if selection.was_simplified():
        return
    known, score = _known(selection), selection.score
    sets = simpler(best, effects, known, best.chi2 + CLOSE * score.scale, score.free)
    fewer = without_weak(best, lambda effect: score.scale * score.price([effect]))
    sets += [fewer] if fewer and frozenset(fewer[0]) not in known else []
    _passed(selection, shooting, sets, best, work)
    _from_the_best(selection, shooting, best, [some for some in sets if holds_simpler_law(some, best)])
    left, known, free = selection.best, _known(selection), selection.score.free
    for some in (forms_of_parts(selection, effects, known), with_another_past(left, effects, known, free)):
        _passed(selection, shooting, some, left, work)  # each among its like: forms of parts begin far off


def refine(selection: Selection, shooting: Shooting, effects: Sequence[Effect], work: float = np.inf) -> bool:
    """Tries laws that contain those of the best set in their place; whether one became the best.

    What leaves noise alone is not developed any more, for one more name, and a richer law costs less than that.
    """
    best, known = selection.best, _known(selection)
    sets = [some for some in richer(best, effects) if frozenset(some[0]) not in known]
    if sets and selection.score.refines:
        compare(shooting, selection, sets, best, Effort(_ROUNDS, work), below=best)
    return selection.best is not best


def _room(shooting: Shooting, work: float) -> int:
    """How many fits end within so many time steps."""
    return int(min(max(work, 0.0) / (_A_FIT * shooting.engine.steps_in(shooting.segments)), _NO_END))


def _known(selection: Selection) -> dict[frozenset[Effect], float]:
    """The least chi2 of each set that was fitted."""
    known: dict[frozenset[Effect], float] = {}
    for fit in selection.fits:
        known[frozenset(fit.effects)] = min(fit.chi2, known.get(frozenset(fit.effects), np.inf))
    return known


def _passed(selection: Selection, shooting: Shooting, sets: Sequence[Set], best: Fit, work: float) -> None:
    """Fits those of some sets that pass a heat, from the states of the best one, the first that end by then."""
    if sets := without_needless_bristles(sets, selection):
        passed = heat(shooting, sets, best, selection.score, work)
        most = max(_FIRST, _room(shooting, work - shooting.work))
        compare(shooting, selection, passed.sets[:most], best, Effort(_ROUNDS, work), starts=passed.starts[:most])


def _from_the_best(selection: Selection, shooting: Shooting, best: Fit, sets: Sequence[Set]) -> None:
    """Fits sets anew that fit worse than they do with the parameters and states of the best one.

    Those found on a part of the data may lead nowhere: on a machine that strikes, a viscous friction ended in one
    segment at 200 in chi2, and an asymmetric one was named that was the same both ways within 4 %.
    """
    ended = [(some, known) for some in sets if (known := selection.of(some[0])) is not None]
    far = best.chi2 + CLOSE * selection.score.scale
    behind = [(some, known.chi2) for some, known in ended if known.chi2 > far and _differ_in_few(known, best)]
    if not behind:
        return
    held = shooting.fit([some for some, _ in behind], best.starts, _GLANCE, hold=True, near=best)
    better = [fit for fit, (_, chi2) in zip(held, behind, strict=True) if fit.chi2 < chi2]
    if better:
        starts = np.stack([fit.starts for fit in better])
        sets = [(fit.effects, fit.values) for fit in better]
        compare(shooting, selection, sets, best, Effort(_ROUNDS), starts=starts)


def _differ_in_few(fit: Fit, best: Fit) -> bool:
    """Whether half of what a fit leaves beyond another is in a tenth of the segments."""
    more = np.sort(fit.per_segment - best.per_segment)[::-1]
    return bool(more[: int(np.ceil(_FEW * len(more)))].sum() > 0.5 * more.sum())


def be_fair(selection: Selection, shooting: Shooting) -> None:
    """Fits the nominal, and the best set without each name, once more with its states where it gains little on them.

    Other states may be all that gains: on a joint that sticks, or on the other side of an impact.
    """
    best, nominal = selection.best, selection.nominal
    if not best.effects or best is selection.beside:
        return
    selection.beside = best
    parts = [(), *(tuple(e for e in best.effects if e is not one) for one in best.effects if len(best.effects) > 1)]
    known = [nominal if not part else selection.of(part) for part in parts]
    again = [
        borrowed(shooting, fit, best)
        for fit in known
        if fit is not None and fit.chi2 - best.chi2 < (NEARLY if fit.effects else _SOME) * shooting.dof
    ]
    selection.add([fit for fit in again if fit.effects and fit not in known])
    bare = next((fit for fit in again if not fit.effects), nominal)
    if bare.chi2 < nominal.chi2:
        selection.nominal, selection.fits = bare, [bare if fit is nominal else fit for fit in selection.fits]
        selection.forget_parts()
    if again:
        selection.rescale(shooting.dof)


def _proposals(selection: Selection, fit: Fit, screened: Screen, effects: Sequence[Effect], most: int) -> list[Set]:
    """The most promising sets that contain one more effect, or several where these help together, best first.

    What hides behind a tuning comes before all others, and several with a vector along more axes before those without.
    """

    def left(score: Score, gain: float, some: Sequence[Effect]) -> float:
        return gain / score.scale - score.price(some)

    def worth(score: Score, atoms: tuple[Atom, ...]) -> float:
        gain = screened.joint_gain(atoms) if len(atoms) > 1 else atoms[0].gain
        return left(score, gain, [a.effect for a in atoms])

    best = screened.best()
    singles = [a for a in best[: 4 * most] if worth(selection.score, (a,)) > 0.0]
    singles.sort(key=lambda a: -worth(selection.score, (a,)))
    chosen: list[Sequence[Atom]] = [(a,) for a in diverse(singles, most)]
    least = worth(selection.score, tuple(chosen[-1])) if len(chosen) == most else 0.0
    lenient = functools.cache(functools.partial(worth, selection.score.before_any_fit(selection.nominal)))
    together = companies(best[:_COMPANY], lenient, MAX_EFFECTS - selection.score.names_in(fit.effects), _MORE)
    together += repeated(fit, screened, lenient, _MORE)
    in_more = functools.partial(
        in_more_axes, screened=screened, effects=effects, worth=functools.partial(left, selection.score), least=_MORE
    )
    vectors = in_more([(atom,) for atom in best if atom.effect.vector])  # any axis, which may gain nothing alone
    chosen += [some for some in vectors if worth(selection.score, tuple(some)) > least]
    chosen += [with_values(company, screened.together(company)[1]) for company in together]
    chosen.sort(key=lambda some: -worth(selection.score, tuple(some)))
    chosen = [*in_more(together), *chosen]
    if not fit.effects:
        gains = [screened.joint_gain(company) for company in together]
        alone = max((a.gain for a in singles), default=0.0)
        hidden = beside(screened, selection.score.a_parameter, alone, max([alone, *gains]))
        if hidden:
            free = frozenset(atom.effect.key for atom in screened.atoms if atom.effect.tunable)
            selection.score = dataclasses.replace(selection.score, free=free)
        chosen = [*hidden, *chosen]
    return [join(fit, some) for atoms in chosen for some in also_from(atoms)]
