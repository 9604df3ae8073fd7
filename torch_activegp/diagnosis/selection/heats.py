"""Sets tried on a part of the data first: most that look promising to first order need no fit to all of it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.selection.proposals import Set
from torch_activegp.diagnosis.shooting.chaining import stands_out
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.race import RACERS, Race, reach
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.effect import Effect

PART = 0.2
"""Least share of the segments."""
CLOSE = 40.0
"""Chi2 by which a set that costs no more may fit worse on the part and be tried on all data."""
_HALF = 0.5
"""A larger part saves nothing: 24 sets took 20 million time steps on four fifths of the data, and 19 of them passed."""
_CLEAR = 100.0
"""What a set must gain on all data is to be as much on the part: far above the noise of a gain."""
_LENIENT = 0.3
"""And so much of it is enough there: effects act more in some segments than in others."""
_ROUNDS = 20
"""Of the fits to segments in which something may strike."""

_SAME = 0.01
"""Values that differ by less, relative to themselves, are the same place."""


class Heat(NamedTuple):
    """What passed.

    Args:
        sets: effects and first guesses.
        starts: initial states to begin from, one for each set, ``(N, S, nq + nv)``: in the segments of the part those
            found there. A set that was found there fitted all data worse than the nominal from the nominal's states.
    """

    sets: list[Set]
    starts: Array


def heat(shooting: Shooting, sets: Sequence[Set], fit: Fit, score: Score, work: float = np.inf) -> Heat:
    """Those of some sets that gain on a part of the data about what they must gain on all of it.

    Half of the part are the segments that the fit explains worst. Where little is missing all data are needed to see
    it, and all sets pass. Sets that cost less than the fit may lose there what they save.

    Args:
        shooting: the likelihood.
        sets: what is proposed, with first guesses.
        fit: what they are to be better than.
        score: what they must gain.
        work: time steps of all that was computed by then, from which on none is fitted further.

    Returns:
        The sets; those that were tried have the parameters and states found on the part.
    """
    every = _struck(shooting, sets, fit, work)
    paid = score.price(fit.effects)
    priced = [(some, score.price(some[0]) - paid) for some in every.sets]
    hot = np.array([not 0.0 <= price <= _CLEAR for _, price in priced], dtype=bool)
    if not hot.any():
        return every
    tried = [pair for pair, is_hot in zip(priced, hot, strict=True) if is_hot]
    share = max(_CLEAR / min((price for _, price in tried if price > 0.0), default=np.inf), PART)
    part, which = shooting.subset(share, fit.per_segment)
    if share > _HALF or part.segments.size == shooting.segments.size:
        return every
    share = part.segments.size / shooting.segments.size
    bars = [score.scale * (-share * price + CLOSE if price < 0.0 else -_LENIENT * share * price) for _, price in tried]
    passed = near(part, which, [some for some, _ in tried], fit, bars, work, every.starts[hot])
    cheap = [some for some, is_hot in zip(every.sets, hot, strict=True) if not is_hot]
    return Heat([*cheap, *passed.sets], np.concatenate([every.starts[~hot], passed.starts]))


def _struck(shooting: Shooting, sets: Sequence[Set], fit: Fit, work: float) -> Heat:
    """Some sets with states of a fit to begin from, but where something in them may strike that the fit does not hold.

    What strikes is sought in the segments that the fit explains worst by far, from the recording: there its states are
    a compromise between before and after an impact. From them, none of six guesses led to a stop that a carriage struck
    once, and from the recording all six.
    """
    begun, starts = list(sets), np.repeat(fit.starts[None], len(sets), axis=0)
    new = [any(effect.strikes for effect in set(effects) - set(fit.effects)) for effects, _ in sets]
    out = stands_out(shooting, fit)
    if not any(new) or not out.any():
        return Heat(begun, starts)
    part, places = shooting.pick(out), [i for i, is_new in enumerate(new) if is_new]
    trials = part.fit([sets[i] for i in places], part.engine.starts(part.segments), _ROUNDS, work=work)
    for i, trial in zip(places, trials, strict=True):
        if trial.chi2 < fit.per_segment[out].sum():
            found, (effects, values) = trial.by_effect, sets[i]
            held = zip(effects, values, strict=True)
            begun[i] = effects, tuple(v if e in fit.effects else found[e] for e, v in held)
            starts[i, out] = trial.starts
    return Heat(begun, starts)


def seen_on(shooting: Shooting, fit: Fit, score: Score) -> tuple[Shooting, Fit]:
    """A part of the data on which what is worth a name on all of them stands out, and the fit there.

    Half of them are those that the fit explains worst. All where little is missing; on top of the nominal; and where
    something is tuned, for its corrections cost little more than what noise gains.
    """
    least = 0.0 if score.free or not fit.effects else score.cheapest
    if least <= _CLEAR:
        return shooting, fit
    part, which = shooting.subset(max(_CLEAR / least, PART), fit.per_segment)
    return part, fit.pick(which)


def near(
    part: Shooting,
    which: NDArray[np.int64],
    sets: Sequence[Set],
    fit: Fit,
    bars: Sequence[float],
    work: float = np.inf,
    starts: Array | None = None,
) -> Heat:
    """Those of some sets whose chi2 on a part of the data is below that of a fit and a bar on top, one for each.

    And, with that bar, among the best three or close to the best: others hardly become the best on all data. A set that
    began from several first guesses is one of the three, and passes once for each place where it ended.

    Args:
        part: the likelihood over some of the S segments.
        which: of all these are, ``(S',)``.
        sets: N proposals, with first guesses.
        fit: to all segments.
        bars: chi2, N of them.
        work: as in `heat`.
        starts: to begin from in all S segments, one for each set, ``(N, S, n)``, where not those of the fit.

    Returns:
        The sets with the parameters and states found on the part.
    """
    here = fit.pick(which)
    begin = here.starts if starts is None else starts[:, which]
    trials = part.fit(sets, begin, race=Race(), near=here, below=here, work=work)
    ended = sorted(zip(trials, bars, strict=True), key=lambda pair: pair[0].chi2 - pair[1])
    first: dict[frozenset[Effect], float] = {}
    for trial, bar in ended:
        first.setdefault(frozenset(trial.effects), trial.chi2 - bar)
    best = list(first.values())[:RACERS]
    close = max(reach(best[0], here.chi2), best[-1]) if best else 0.0
    passed: list[Fit] = []
    for trial, bar in ended:
        if trial.chi2 - bar < here.chi2 and trial.chi2 - bar <= close and not any(_same(trial, old) for old in passed):
            passed.append(trial)
    starts = np.repeat(fit.starts[None], len(passed), axis=0)
    for states, trial in zip(starts, passed, strict=True):
        states[which] = trial.starts
    return Heat([(trial.effects, trial.values) for trial in passed], starts)


def _same(one: Fit, other: Fit) -> bool:
    """Whether two fits of a set ended in the same place."""
    there, alike = other.by_effect, functools.partial(np.allclose, rtol=_SAME, atol=0.0)
    return one.by_effect.keys() == there.keys() and all(alike(v, there[e]) for e, v in one.by_effect.items())
