"""Names that stand for the same: what scores almost as well, and laws that are one law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.selection.compared import Selection, in_place
from torch_activegp.diagnosis.selection.intervals import certainty
from torch_activegp.diagnosis.selection.merging import TWO_SIDED, push
from torch_activegp.diagnosis.selection.proposals import contains, of_part
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import TIE
from torch_activegp.diagnosis.simulation.touching import strikes
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.friction import DryFriction

_LOPSIDED = 0.1
"""A constant push is a difference between the directions of a dry friction from so much of that friction up."""
_DELAYS = frozenset({"actuator_delay", "sensor_delay"})
_SHIFTED = 0.02
"""Part of chi2 by which two delays that are one law may differ: by 0.006 where one of 8 ms was taken in steps of 5."""
_STRIKES = 20.0
"""Score by which sets differ that are not told apart on a machine that strikes something: fits end on either side of an
impact. A lag of a hammer's drive left 16 less than the delay that was there, as long and with the same states."""
ALIKE = 0.002
"""Two names that say the same as one leave no more by this part, what fits are short of; less is no objection."""

_SURE = 100.0
"""Wald's statistic of an amplitude from which on a simple law is told from those that contain it: a level ten standard
errors from nothing shows whether the other direction has half of it. Of 23 viscous and dry frictions that were named in
the proof two were less sure (5.5 and 6.7 standard errors), and neither was the law that was missing."""
_OTHER = 0.45
"""Part of a simple law's amplitude, nearly half, by which a law that contains it is another one. None of four right
frictions in the proof has such a tie, and a Stribeck friction that passed for Coulomb's."""

_NO_WORSE = 12.0
"""Chi2, in units of what is left, by which a law that contains a simple one may leave more and be there as well, where
its numbers are held (:mod:`~torch_activegp.diagnosis.selection.static_friction`) and the level is not fitted anew: 8
more were left so where Stribeck's friction was there, and 32 to 2500 where Coulomb's was. One that is fitted: `TIE`."""

Rivals = Sequence[tuple[Fit, float, float]]
"""Compared sets, best first, with their scores less the best one's and their probabilities."""
Keys = frozenset[tuple[str, str]]
"""Names and targets."""


def ties_of(
    rivals: Rivals,
    best: Fit,
    effect: Effect,
    retuned: Sequence[Effect],
    tuned: Sequence[Effect],
    one_way: bool = False,
    tunable: Sequence[Effect] = (),
    within: float = TIE,
) -> tuple[tuple[str, str], ...]:
    """All (name, target) pairs that stand for a named effect as well.

    Args:
        rivals: the compared sets.
        best: the one that was chosen.
        effect: of it.
        retuned: effects of it that are not named.
        tuned: those of them that only undo a tuning.
        one_way: whether one control goes in, and one position comes out.
        tunable: all that a modeller may have tuned, compared or not.
        within: score by which sets differ that are not told apart, :func:`told_apart_by`.
    """
    beside = unnamed(retuned, tuned, tunable) - {effect.key}
    alone, one = swapped(rivals, best, effect, within, beside), as_one(rivals, best, effect, retuned, tuned)
    is_a_delay = effect.name in _DELAYS or any(name in _DELAYS for name, _ in alone)  # as a short lag may be
    late = as_late(rivals, best, effect, beside) if one_way and is_a_delay else ()
    return tuple(dict.fromkeys([*alone, *late, *as_two(rivals, best, effect, tunable), *one]))


def told_apart_by(shooting: Shooting, best: Fit) -> float:
    """The score by which sets must differ to be told apart: more where something touches now and then."""
    engine = shooting.engine
    stopped = any(effect.name == "joint_stop" for effect in best.effects)
    return _STRIKES if stopped or strikes(engine.model, engine.channels, shooting.segments.runs) else TIE


def unnamed(retuned: Sequence[Effect], tuned: Sequence[Effect], tunable: Sequence[Effect]) -> Keys:
    """What sets may have or not and say the same: what is not named, and where a tuning is undone, all that does it.

    On a pendulum that was tuned, another gravity and another centre of mass left the same to 1e-9, one beside a push
    and the other beside a drive's bias.
    """
    return frozenset(effect.key for effect in (*retuned, *(tunable if tuned else ())))


def swapped(
    rivals: Rivals, best: Fit, effect: Effect, within: float = TIE, beside: Keys = frozenset()
) -> tuple[tuple[str, str], ...]:
    """What stands in place of an effect in sets that score almost as well, whatever they have `beside` it."""
    others = best.keys - {effect.key} - beside
    found = []
    for fit, distance, _ in rivals[1:]:
        new = fit.keys - others - beside or fit.keys - best.keys
        if distance < within and others <= fit.keys and len(new) == 1 and effect.key not in fit.keys:
            found.append(next(iter(new)))
    return tuple(dict.fromkeys(found))


def is_one_way(shooting: Shooting) -> bool:
    """Whether one control goes in, and one position comes out: no other was used or recorded, nor a force known."""
    channels, runs = shooting.engine.channels, shooting.segments.runs
    used = np.any([run.control.any(axis=0) for run in runs], axis=0).sum()
    alone = len(channels.joints) == 1 and channels.prescribed is None
    return bool(alone and used == 1 and not any(run.force.any() for run in runs))


def as_late(rivals: Rivals, best: Fit, effect: Effect, beside: Keys = frozenset()) -> tuple[tuple[str, str], ...]:
    """The delay at another end of a machine with one control and one position: there both are one law.

    Whatever moves by a control that comes late moves as late, and free initial states know no clock. Their fits differ
    by how a delay that is no whole number of time steps is simulated. Asked of a delay, and of what one ties with,
    whatever else is `beside` it.
    """
    others = best.keys - {effect.key} - beside
    found = []
    for fit, _, _ in rivals[1:]:
        new = fit.keys - others - beside
        other = next(iter(new)) if len(new) == 1 else effect.key
        alike = others <= fit.keys and fit.chi2 - best.chi2 < _SHIFTED * best.chi2
        if alike and other[0] in _DELAYS - {effect.name}:
            found.append(other)
    return tuple(found)


def is_as_late(best: Fit, fit: Fit) -> bool:
    """Whether two sets of a machine with one control and one position differ by where a delay is: in nothing."""
    delays = [effect for effect in best.effects if effect.name in _DELAYS]
    return any(as_late([(best, 0.0, 0.5), (fit, 0.0, 0.5)], best, effect) for effect in delays)


def as_part(
    shooting: Shooting, selection: Selection, effect: Effect, beside: Keys = frozenset()
) -> tuple[tuple[str, str], ...]:
    """The laws that contain a simple one of the best set and fit no worse, where they differ by half or it is weak.

    By half of what there is of it, the model's own dry friction among it.

    Such a law costs more, and gains too little for its price; but the recordings do not say that it is not there. On a
    pendulum with dry friction of 0.04 N m, static parts from 0.02 to 0.05 N m fitted as well as none.

    Args:
        shooting: the likelihood.
        selection: what was compared.
        effect: of the best set.
        beside: what either set may have or not, :func:`unnamed`.
    """
    best, found = selection.best, dict[tuple[str, str], None]()
    if effect.linear != 1 or best.at_rest:
        return ()
    level, weak = float(best.by_effect[effect][0]), certainty(shooting, best, effect) < _SURE
    much = _OTHER * abs(level + (effect.nominal_loss if isinstance(effect, DryFriction) else 0.0))
    fits = [*((fit, TIE) for fit in selection.fits), *((fit, _NO_WORSE) for fit in selection.held)]
    for fit, within in fits:
        old, law = in_place(best, fit, beside) or (None, effect)
        as_good = fit.plausible and not fit.at_rest and fit.chi2 - best.chi2 <= within * selection.score.scale
        if old is not effect or not contains(law, effect) or not as_good:
            continue
        if weak or abs(fit.by_effect[law] - of_part(law, level))[: law.linear].max() > much:
            found[law.key] = None
    return tuple(found)


def as_two(rivals: Rivals, best: Fit, effect: Effect, tunable: Sequence[Effect] = ()) -> tuple[tuple[str, str], ...]:
    """The names that say the same as a dry friction of two levels: one level, and a constant push or a drive's bias.

    Of these one is compared; those of some `tunable` effects that push the joint do what it does.
    """
    others, dry, found = best.keys - {effect.key}, ("coulomb_friction", effect.target), set[tuple[str, str]]()
    for fit, _, _ in rivals[1:] if effect.name == TWO_SIDED else ():
        new = fit.keys - others
        if fit.chi2 - best.chi2 < ALIKE * best.chi2 and others <= fit.keys and len(new) == 2 and dry in new:
            found |= new
    alike = {e.key for e in tunable if push(e, np.ones(1), effect.target)} if found else set()
    return tuple(sorted(found | (alike - others)))


def as_one(
    rivals: Rivals,
    best: Fit,
    effect: Effect,
    retuned: Sequence[Effect],
    tuned: Sequence[Effect] = (),
) -> tuple[tuple[str, str], ...]:
    """The dry friction of two levels that says the same as one level and a push which only undoes a tuning.

    Where some effects only undo a tuning at that joint (`tuned`), the nominal's bias there may hold the push, and
    nothing in the recordings says how much of it.
    """
    values, two_sided = best.by_effect, (TWO_SIDED, effect.target)
    if effect.name != "coulomb_friction":
        return ()
    here = any(other.acts_on == effect.target for other in tuned)
    if here and any(two_sided in fit.keys for fit, _, _ in rivals):
        return (two_sided,)
    least = _LOPSIDED * float(values[effect][0])
    pushes = {e.key for e in retuned if abs(push(e, values[e], effect.target)) > least}
    for fit, _, _ in rivals[1:] if pushes else ():
        alike = fit.chi2 - best.chi2 < ALIKE * best.chi2
        if alike and two_sided in fit.keys and fit.keys - {two_sided} <= best.keys - {effect.key} - pushes:
            return (two_sided,)
    return ()
