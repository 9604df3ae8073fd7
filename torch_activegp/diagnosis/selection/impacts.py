"""Sets in which something is struck: from the other side of an impact, and with a stop further in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.proposals import Set
from torch_activegp.diagnosis.shooting.chaining import chained, stands_out
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.touching import strikes
from torch_activegp.physics.effect import Effect

_BEST = 4
"""So many of the best sets are looked at."""
_MOSTLY, _MUCH, _NEARLY = 2 / 3, 20.0, 0.25
"""A rival has gone astray where a tenth of the segments hold so much of all that it leaves more than the best set: that
is so much chi2 at least, and so small a part of what the best set explains at most."""
_ROUNDS = 20
"""Of fits with a stop further in: those that lead there do in fewer."""


def behind_impacts(
    selection: Selection, shooting: Shooting, new: Sequence[frozenset[Effect]], work: float = np.inf
) -> None:
    """Fits some new sets that are among the best anew, :func:`chained`, and the smallest with its stops further in.

    Where the machine strikes something, or an effect of a set does. A right rotor left 190 more than noise in one
    segment that began on the wrong side of an impact, 70 more than a wrong spring, and was never looked at again. A
    stop that was missing left 46 times the noise in a segment that began against it. Begun in front of it, it was found
    16 mrad too far out, where two of the three segments that strike it reach it; the third left 6.7 times the noise,
    which a spring and a cogging explained.

    Args:
        selection: the compared sets; takes the new fits in.
        shooting: the likelihood by which they were compared.
        new: the sets.
        work: time steps of all that was computed by then, from which on no other one is begun.
    """
    near = [fit for fit in selection.ranked()[:_BEST] if frozenset(fit.effects) in new and not fit.at_rest]
    if not near or shooting.work >= work:
        return
    engine = shooting.engine
    model_strikes = strikes(engine.model, engine.channels, shooting.segments.runs)
    stopped, found = list[Fit](), list[Fit]()
    for fit in near:
        if (model_strikes or any(effect.strikes for effect in fit.effects)) and shooting.work < work:
            again = chained(shooting, fit)
            found += [] if again is fit else [again]
            stopped += [again] if _further_in(again) else []
    if stopped and shooting.work < work:
        smallest = min(stopped, key=lambda fit: len(fit.effects))  # another place needs no more beside it
        further = with_stops_further_in(shooting, smallest, work)
        found += [] if further is smallest else [further]
    if selection.add(found):
        selection.rescale(shooting.dof)
        selection.lighten()


def led_back(shooting: Shooting, best: Fit, rivals: Sequence[Fit], nominal: float) -> list[Fit]:
    """Rivals that an impact led astray, fitted anew: first to the segments in which they are about as good as the best.

    Of as many names, on a machine that strikes, and from the best set's states. What ended on the wrong side of an
    impact draws the parameters along, and from there no state of that segment leads back: a rotor came 20 % too light,
    with 700 of the 1072 that it left more than a load in one of 54 segments; it left as much as the load did so.

    Args:
        shooting: the likelihood by which they were compared.
        best: the best set.
        rivals: others.
        nominal: chi2 of the nominal.

    Returns:
        Those that are better so.

    Reference: Rousseeuw, *Least Median of Squares Regression*, J. of the American Statistical Association 79 (1984):
    least trimmed squares.
    """
    near = [fit for fit in rivals if _is_astray(shooting, fit, best, nominal)]
    if not near:
        return []
    sets = list[Set]()
    for fit in near:
        more = fit.per_segment - best.per_segment
        alike = np.flatnonzero(more < np.partition(more, -_few(shooting))[-_few(shooting)])
        part = shooting.pick(alike).fit([(fit.effects, fit.values)], best.starts[alike])[0]
        sets.append((fit.effects, part.values))
    ends = shooting.fit(sets, best.starts)
    return [end for end, fit in zip(ends, near, strict=True) if end.chi2 < fit.chi2]


def _is_astray(shooting: Shooting, fit: Fit, best: Fit, nominal: float) -> bool:
    """Whether few segments hold most of what a rival leaves more than the best set, on a machine that strikes."""
    behind, more = fit.chi2 - best.chi2, fit.per_segment - best.per_segment
    if not _MUCH < behind < _NEARLY * (nominal - best.chi2) or fit.at_rest or len(fit.effects) != len(best.effects):
        return False
    few, above = np.sort(more)[len(more) - _few(shooting) :], np.maximum(more, 0.0)
    if not _few(shooting) or few.sum() < _MOSTLY * above.sum():
        return False
    engine, runs = shooting.engine, shooting.segments.runs
    return any(effect.strikes for effect in fit.effects) or strikes(engine.model, engine.channels, runs)


def _few(shooting: Shooting) -> int:
    """A tenth of the segments; none where there are not ten."""
    return shooting.segments.size // 10


def with_stops_further_in(shooting: Shooting, fit: Fit, work: float = np.inf) -> Fit:
    """The fit with one of its stops further in, where that is better: what does not reach it has no derivative by it.

    Args:
        shooting: the likelihood.
        fit: of any set; the same where no segment stands out, or nothing is struck.
        work: time steps of all that was computed by then, from which on fits end.
    """
    sets = _further_in(fit)
    if not sets or not stands_out(shooting, fit).any():
        return fit
    best = fit
    for end in shooting.fit(sets, fit.starts, _ROUNDS, near=fit, work=work):
        best = min(best, chained(shooting, end) if shooting.work < work else end, key=lambda one: one.chi2)
    return best


def _further_in(fit: Fit) -> list[Set]:
    """The set with each of its stops further in."""
    return [
        (fit.effects, (*fit.values[:i], other, *fit.values[i + 1 :]))
        for i, effect in enumerate(fit.effects)
        for other in effect.further_in(fit.values[i])
    ]
