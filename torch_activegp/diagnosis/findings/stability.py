"""Whether the named effects and their parameters stand when each recording is left out in turn."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from torch_activegp.diagnosis.findings.refit import Refits, refit
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.result import EffectStability, Spread, Stability
from torch_activegp.diagnosis.selection.compared import Selection, fitted
from torch_activegp.diagnosis.selection.intervals import standard_errors
from torch_activegp.diagnosis.selection.judge import Judgement
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.effect import Effect

_MOST = 12
"""Beyond so many recordings, neighbours are left out together."""
_FAR = 2.5
"""A shift by more standard errors is worth a warning."""
_CLEARLY_WORSE = 10.0
_OF_THE_OTHERS = 0.01
"""So is an effect that raises the chi2 of a recording by more than this and this part of what it gains on others."""
_OF_ITS_GAIN = 0.1
_WEAK = 100.0
"""An effect is refuted where it makes forecasts worse by so much of what it gains beyond this on what it was fitted to.
What gains less should improve forecasts by nearly as much, and by chance makes them worse; what gains more may be a law
whose fits to fewer recordings got stuck."""
_OF_ITS_WINS = 1 / 3
"""So it is where it loses so much of what it wins on other recordings: of 110 right names none lost more than 5 on any,
and two that stood for a friction that grows with the load lost 0.5 and 0.7."""
_NO_CHANCE = 500.0
"""So does what gains so much and leaves white noise alone: a hard stop that one recording strikes and another grazes
gained 1890, and made the forecast of the second worse by 715."""

_BY_CHANCE = 0.01
"""Chance that coins make no more tails than an effect makes clear forecasts of recordings worse. On a drive that cogs
dry and viscous friction left 280 times the noise with an encoder's gain of 1.027, and 444 without. The frictions made
the forecasts of all 12 recordings better, the gain of 10, and two clearly worse (0.02)."""


def stability(shooting: Shooting, selection: Selection, judgement: Judgement) -> Stability | None:
    """Fits the named set without each recording in turn, and forecasts that recording.

    An effect rests on a recording if its gain on all the others would not pay for its name there; what the others then
    say about its parameters is left out of their spread.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
        judgement: the verdict.

    Returns:
        None where nothing is named, or where there are fewer than two segments.
    """
    if judgement.verdict not in ("named", "tie") or shooting.segments.size < 2:
        return None
    labels, kept = _parts(shooting.segments)
    whole = refit(shooting, judgement.fit, np.concatenate([kept, np.ones_like(kept[:1])]))
    every = [_effect(shooting, selection, judgement, effect, (labels, kept, whole)) for effect in judgement.named]
    sentence, sound = _in_words(labels, every, len(shooting.segments.runs) == 1)
    return Stability(tuple(labels), tuple(every), sentence, sound)


def _parts(segments: Segments) -> tuple[list[str], NDArray[np.bool_]]:
    """What is left out each time, in words, and the segments that are kept, ``(R, S)``."""
    present = np.unique(segments.run)
    if len(present) == 1:
        name = segments.runs[present[0]].label
        centers, time = segments.centers(), segments.runs[present[0]].time
        middle = (time[0] + time[-1]) / 2
        first = centers < (middle if centers.min() < middle <= centers.max() else (centers.min() + centers.max()) / 2)
        return [f"the first half of {name}", f"the second half of {name}"], np.stack([~first, first])
    groups = np.array_split(present, min(len(present), _MOST))
    labels = [", ".join(segments.runs[number].label for number in group) for group in groups]
    return labels, np.stack([~np.isin(segments.run, group) for group in groups])


def _effect(
    shooting: Shooting,
    selection: Selection,
    judgement: Judgement,
    effect: Effect,
    parts: tuple[list[str], NDArray[np.bool_], Refits],
) -> EffectStability:
    """What becomes of one effect; the last of the fits is to everything."""
    (labels, kept, whole), fit = parts, judgement.fit
    others = [e for e in fit.effects if e is not effect]
    without = refit(shooting, fitted(shooting, selection, others), kept)
    fall = (without.per_segment - whole.per_segment[:-1]) / selection.score.scale
    inside, outside = (np.where(which, fall, 0.0).sum(axis=1) for which in (kept, ~kept))
    rests = inside < np.array([_price(selection.score, shooting.pick(part), effect) for part in kept])
    gains = [
        None if alone or not np.isfinite(gain) else float(gain) for alone, gain in zip(rests, outside, strict=True)
    ]
    fails = [np.where(rests, 0.0, outside) == end for end in (np.inf, -np.inf)]
    without_it, with_it = (tuple(label for label, one in zip(labels, end, strict=True) if one) for end in fails)
    return EffectStability(
        effect.name,
        effect.target,
        tuple(gains),
        tuple(label for label, alone in zip(labels, rests, strict=True) if alone),
        _spreads(shooting, fit, effect, whole.values, [(i, label) for i, label in enumerate(labels) if not rests[i]]),
        without_it,
        with_it,
        not without_it and is_refuted(gains, float(inside.max()), judgement.white, selection.score.inadequate),
    )


def is_refuted(gains: Sequence[float | None], gain: float, white: bool, loud: bool = False) -> bool:
    """Whether forecasts of recordings left out refute an effect.

    Where much more than noise is left, which lasts as noise does not, the recordings are what counts, and not how many
    rows they have: two at least that an effect makes worse must be no more than a toss of coins leaves.

    Args:
        gains: by how much it lowers the chi2 of each, where the others say something about it.
        gain: the same of the recordings that it was fitted to.
        white: whether the named set leaves white noise alone.
        loud: whether it leaves much more than noise.
    """
    if white and gain > _NO_CHANCE:
        return False
    known = [each for each in gains if each is not None]
    worse = sum(each < -_CLEARLY_WORSE for each in known)
    clear = worse + sum(each > _CLEARLY_WORSE for each in known)
    if loud and worse > 1 and stats.binom.cdf(worse, clear, 0.5) > _BY_CHANCE:
        return True
    wins, losses = (sum(max(sign * each, 0.0) for each in known) for sign in (1.0, -1.0))
    many = losses > _OF_ITS_WINS * wins and len(known) > 2
    return min(known, default=0.0) < -_CLEARLY_WORSE and (many or sum(known) < -_OF_ITS_GAIN * max(gain - _WEAK, 0.0))


def _price(score: Score, part: Shooting, effect: Effect) -> float:
    """What an effect must gain on a part of the data to be told from noise."""
    return dataclasses.replace(score, samples=part.samples, mismatch=0.0).price([effect])


def _spreads(
    shooting: Shooting, fit: Fit, effect: Effect, values: NDArray[np.float64], said: Sequence[tuple[int, str]]
) -> dict[str, Spread]:
    part = values[:, fit.places[effect]]
    center, errors = effect.describe(part[-1]), standard_errors(shooting, fit, effect, recordings=False)
    found = [(label, effect.describe(part[i])) for i, label in said]
    out = {}
    for name, value in center.items() if found else ():
        farthest, there = max(found, key=lambda pair: abs(pair[1][name] - value))
        ends = [described[name] for _, described in found]
        out[name] = Spread(min(ends), max(ends), abs(there[name] - value) / max(errors[name], 1e-300), farthest)
    return out


def _in_words(labels: Sequence[str], effects: Sequence[EffectStability], single: bool) -> tuple[str, bool]:
    """The finding in a sentence, and whether it is no warning."""
    counts = [f"{effect.name} at {effect.target} improves {effect.improved} of {len(labels)}" for effect in effects]
    of = "The one recording in two halves, each left out in turn" if single else "Each recording left out in turn"
    said = f"{of} and forecast from the rest: {', '.join(counts)}"
    warnings = [words for effect in effects for words in _warnings(effect, labels)]
    shifts = [spread.shift for effect in effects for spread in effect.parameters.values()]
    if shifts and max(shifts) <= _FAR:
        said += f"; no parameter moves by more than {max(shifts):.2g} standard errors"
    return "; ".join([said, *warnings]) + ".", not warnings


def _warnings(effect: EffectStability, labels: Sequence[str]) -> list[str]:
    name = f"{effect.name} at {effect.target}"
    out = []
    if len(effect.rests_on) == 1:
        out.append(f"{name} rests on {effect.rests_on[0]} alone: the rest is not enough to name it")
    elif effect.rests_on:
        out.append(f"the evidence for {name} is just enough: it needs each of {'; '.join(effect.rests_on)}")
    least = -_CLEARLY_WORSE - _OF_THE_OTHERS * sum(max(gain or 0.0, 0.0) for gain in effect.gains)
    worse = [label for label, gain in zip(labels, effect.gains, strict=True) if gain is not None and gain < least]
    worse += effect.fails_with
    if worse:
        out.append(f"{name} fitted to the rest makes the forecast of {'; '.join(worse)} worse")
    out += [
        f"{key} of {name} moves by {spread.shift:.1f} standard errors without {spread.farthest}: more than its "
        "interval leads to expect"
        for key, spread in effect.parameters.items()
        if spread.shift > _FAR
    ]
    return out
