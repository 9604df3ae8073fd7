"""Names that stand for other time steps than the machine's recordings were made with."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array, median_step
from torch_activegp.diagnosis.preparation.brief_pieces import begun
from torch_activegp.diagnosis.preparation.late import LIKE_A_TIME_STEP, without_half_steps
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.preparation.own_forms import likeliest
from torch_activegp.diagnosis.preparation.rivals import Rival
from torch_activegp.diagnosis.preparation.telling import enough
from torch_activegp.diagnosis.selection.compared import Selection, fitted
from torch_activegp.diagnosis.selection.proposals import Set
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Effect

_SMALL = 2.0
"""Times the noise that a nominal leaves at most for its time steps to be all that is missing: a hammer's left 1.47 in
steps of 1 ms, and 1.18 in half of that, for 1.16 with a rotor, a gain and a delay."""
_OF_THE_MISMATCH = 0.02
"""Part of the mismatch that half a time step may explain beside what strikes; it was 0.004."""
_HALF = 0.5
"""Part of what another form must gain to make names needless, that it gains on some of the segments to be fitted to
all. On hammers with a delay or a limit they gained nothing, on a leg that was damped a fourth of the names' gain."""


def nameless_in_finer_steps(
    numerics: Numerics, engine: Engine, shooting: Shooting, selection: Selection
) -> tuple[Shooting, Selection] | None:
    """The nominal by another form of the model, mostly in shorter steps, where it does as well as the best set does.

    Impacts end a little elsewhere in each of them. A sphere that bounced on a floor left 1.02 of the noise in steps of
    1 ms, 0.997 with a stop or a damper there, and as much in steps of 0.25 ms without. Where nothing touches, a
    simulator of first order in steps h has h D less inertia than its model at a joint with damping D: on an arm of six
    joints whose truth had steps of 0.2 ms, two rotors came 0.1 % too heavy. Only where that little is missing is it
    asked, and of some of the segments first: shorter steps cost as much longer.

    Args:
        numerics: the forms of the model.
        engine: the form under which sets were compared.
        shooting: the likelihood.
        selection: the compared sets.

    Returns:
        The likelihood by that form and a selection of the nominal alone; None where the names stay.
    """
    best, nominal, score = selection.best, selection.nominal, selection.score
    if not best.effects or nominal.chi2 > _SMALL * shooting.dof:
        return None
    gained = nominal.per_segment - best.per_segment
    wanted = score.scale * (score(nominal) - score(best))  # what names gain, less their price
    least = _HALF * min(wanted / max(nominal.chi2 - best.chi2, 1e-300), 1.0)
    for form in _others(numerics, engine, shooting, nominal):
        finer = dataclasses.replace(shooting, engine=form, offset=None)
        some, part = finer.subset(enough(form, shooting.segments), gained)
        for starts in (nominal.starts, best.starts, None):
            few = _nameless(some, None if starts is None else starts[part])
            if nominal.per_segment[part].sum() - few.chi2 < least * gained[part].sum():
                continue
            fit = few if len(part) == shooting.segments.size else _nameless(finer, starts)
            if score(fit) <= score(best):
                bare = Selection(fit, [fit], score, selection.cut_short, tunable=selection.tunable)
                bare.rescale(shooting.dof)
                return finer, bare
    return None


def of_a_step(numerics: Numerics, engine: Engine, shooting: Shooting, selection: Selection) -> frozenset[Effect]:
    """Effects of the best set that may be half a time step, where the others do as well without them in other steps.

    Those of first order leave so little damping or inertia that they are not taken for a form of the model, which must
    be better by 3 %, and enough for a name beside others: behind servos of 700 N m/rad, simulated in 0.25 ms, a damping
    of -0.056 N m s/rad gained 200 of 11 thousand beside the right delay. What strikes does so when a step ends: beside
    a gap in a leg's knee, in steps of 0.5 ms, a delay of 0.17 ms gained 450 of 116 thousand. And where the nominal came
    closest in the model's own integrator, steps of 0.42 ms, a friction had a delay of 0.18 ms beside it, which it did
    without by Runge-Kutta.

    Args:
        numerics: the forms of the model.
        engine: the form under which sets were compared.
        shooting: the likelihood.
        selection: the compared sets.
    """
    best, row = selection.best, median_step(shooting.segments.runs)
    late = _late(best, row / engine.substeps)
    without = best.part(e for e in best.effects if e not in late)
    if late and any(effect.strikes for effect in best.effects):
        lost = fitted(shooting, selection, without[0]).chi2 - best.chi2
        return late if lost < _OF_THE_MISMATCH * (selection.nominal.chi2 - best.chi2) else frozenset()
    if numerics.stiff:
        return frozenset()
    fine, precise = numerics.fine, dataclasses.replace(shooting, engine=engine, offset=None)
    step = row / numerics.given.substeps
    kept: list[tuple[Set, list[Engine]]]
    kept = [(some, []) for some in without_half_steps([(best.effects, best.values)], numerics.given.model, step)]
    kept += [(without, [fine])] if late and engine in numerics.own else []
    for some, first in kept:
        if some[0] and (found := _does_as_well(numerics, shooting, precise, selection, some, first)):
            return found
    return frozenset()


def _late(fit: Fit, step: float) -> frozenset[Effect]:
    """What is late by less than half of a time step, s, in a set."""
    return frozenset(e for e, v in fit.by_effect.items() if e.name in LIKE_A_TIME_STEP and v[0] < 0.5 * step)


def _does_as_well(
    numerics: Numerics,
    shooting: Shooting,
    precise: Shooting,
    selection: Selection,
    some: Set,
    first: Sequence[Engine],
) -> frozenset[Effect]:
    """What the best set has beyond another one that scores as well in other steps; nothing where that does not.

    Args:
        numerics: the forms of the model.
        shooting: the likelihood by which sets were compared.
        precise: the same by the engine that it stands for.
        selection: the compared sets.
        some: the other set, with first guesses.
        first: forms to ask before the likeliest ones.
    """
    best, score = selection.best, selection.score
    rest = shooting.fit([some], best.starts, near=best)[0]
    for form in [*first, *likeliest(numerics, precise, rest)]:
        other = dataclasses.replace(shooting, engine=form, offset=None)
        if score(other.fit([(rest.effects, rest.values)], rest.starts, near=rest)[0]) <= score(best):
            return frozenset(best.effects) - frozenset(rest.effects)
    return frozenset()


def _others(numerics: Numerics, engine: Engine, shooting: Shooting, nominal: Fit) -> list[Engine]:
    """The forms by which nothing may be missing: in shorter steps where something touches.

    Else those that are closer to the nominal than the one that was taken, for that was chosen behind names; the closest
    first, and of the model's own in shorter steps one of each scheme.
    """
    if numerics.stiff:
        return [form for form in numerics.finer if form.substeps > shooting.engine.substeps]
    if nominal.design is None:
        nominal = shooting.fit([((), ())], nominal.starts, hold=True)[0]
    precise = dataclasses.replace(shooting, engine=engine, offset=None)
    competing = (engine, numerics.fine, numerics.given, numerics.firm, numerics.firm_leapt)
    taken, *others = (Rival.at(precise, form, nominal) for form in dict.fromkeys(competing) if form is not None)
    closer = sorted((rival for rival in others if rival.left < taken.left), key=lambda rival: rival.left)
    return list(dict.fromkeys([*(rival.engine for rival in closer), *likeliest(numerics, precise, nominal)]))


def _nameless(shooting: Shooting, starts: Array | None) -> Fit:
    """The nominal fitted from some initial states, or from those of brief pieces."""
    return shooting.fit([((), ())], begun(shooting) if starts is None else starts)[0]


def without_a_step(numerics: Numerics, engine: Engine, shooting: Shooting, selection: Selection) -> Selection:
    """The sets in which nothing is late by less than the model's own integrator in the next shorter steps would be.

    That integrator has controls half a step early. It is compared in steps of some lengths, and recordings that a
    simulator has made may be of any: to one in 0.1 ms the nearest was 0.125 ms, and a sensor was said to be 20 us late.
    What is within half the difference to the next shorter steps, or half of the shortest, is no name, however much it
    gains; more than that the next shorter steps would have shown.

    Args:
        numerics: the forms of the model.
        engine: the form under which sets were compared.
        shooting: the likelihood.
        selection: the compared sets.
    """
    if engine not in numerics.own:
        return selection
    shorter = (own.substeps for own in numerics.own if numerics.sticks(own) == numerics.sticks(engine))
    following = min((steps for steps in shorter if steps > engine.substeps), default=np.inf)
    half = 0.5 * median_step(shooting.segments.runs) * (1.0 / engine.substeps - 1.0 / following)

    def told(fit: Fit) -> list[Effect]:
        late = (effect.name in LIKE_A_TIME_STEP and value[0] < half for effect, value in fit.by_effect.items())
        return [effect for effect, below in zip(fit.effects, late, strict=True) if not below]

    best = selection.best
    if len(told(best)) == len(best.effects):
        return selection
    selection.add([fitted(shooting, selection, told(best))])
    slower = [fit for fit in selection.fits if len(told(fit)) == len(fit.effects)]
    found = dataclasses.replace(selection, fits=slower)
    found.rescale(shooting.dof)
    return found
