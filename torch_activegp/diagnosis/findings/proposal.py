"""What the next recording should tell: rivals that are still open apart, else the least certain parameter."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from torch_activegp.diagnosis.findings.experiment import Telling, Trial, next_experiment
from torch_activegp.diagnosis.findings.one_more import left_of_errors
from torch_activegp.diagnosis.findings.open_forms import open_forms
from torch_activegp.diagnosis.inputs.runs import Array, Run
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.selection.intervals import covariance
from torch_activegp.diagnosis.selection.judge import Judgement
from torch_activegp.diagnosis.selection.ties import is_as_late, is_one_way, swapped, unnamed
from torch_activegp.diagnosis.shooting.fit import Fit, bounds, split
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.effect import Effect

_RIVALS = 3
_OPEN = 20.0
"""Rivals whose score is worse by more are ruled out."""
_SETTLED, _UNTOLD = "no rival is left", "no controls were found that would tell the rivals apart"
_FAR_BEHIND = 1000.0
"""Points behind the best one from which on a set is none that controls should tell from it, where nothing explains."""
_WELL_KNOWN = 0.02
"""Standard error of the least certain parameter, in parts of it, from which on the user need not record more."""
_HARDLY_LESS = 0.9
"""Part of it from which on what is left of it by one more recording is no gain to speak of."""
_ENDS = 2.0
"""Standard errors from a parameter's estimate to the ends that are to be told apart."""


def propose(
    explanation: Explanation, judgement: Judgement, runs: tuple[Run, ...], seed: int, doubts: Sequence[str] = ()
) -> tuple[dict[str, Any], str] | None:
    """Controls for the machine that tell most, as :func:`next_experiment` has them.

    Where something is named and no rival is left, two models are told apart that have the least certain parameter of
    the names at either end of its interval. Sets that differ in what is fitted along and not named are no rivals.

    Args:
        explanation: the sets.
        judgement: the verdict, and the rivals.
        runs: recordings.
        seed: of the random controls.
        doubts: what seems to be wrong with the recordings; where nothing explains them, that comes first.

    Returns:
        The entry of ``diagnosis.json`` and the CSV text; None where nothing differs, and where no controls would tell.
    """
    if judgement.verdict == "none" or (judgement.verdict == "unknown" and doubts):
        return None
    shooting, engine = explanation.shooting, explanation.engine
    certain = judgement.verdict in ("named", "tie")
    best = judgement.rivals[0][0]
    far = _OPEN if certain else _FAR_BEHIND
    same = _beside(judgement, explanation.selection.tunable)
    rivals = [(fit, distance) for fit, distance, _ in judgement.rivals[1:] if not _says_the_same(fit, judgement, same)]
    others = [fit for fit, distance in rivals[:_RIVALS] if distance < far]
    one_way = is_one_way(shooting)
    for rival in (fit for fit in others if not (one_way and is_as_late(best, fit))):
        found = next_experiment(engine, [best, rival], runs, shooting.noise, seed, shooting.differences)
        if found is not None:
            return found
    if not certain:
        return None
    fit, selection = judgement.fit, explanation.selection
    forms = any(open_forms(selection, fit, effect) for effect in judgement.named)
    open_ones = bool(others) or any(judgement.ties) or forms
    before = _UNTOLD if open_ones else _SETTLED
    errors = covariance(shooting, fit, widened=True)
    ends = least_certain(shooting, fit, errors, before, judgement.white, judgement.named)
    if ends is None:
        return None
    fits, telling = ends
    return next_experiment(engine, fits, runs, shooting.noise, seed, shooting.differences, telling)


def _beside(judgement: Judgement, tunable: Sequence[Effect]) -> frozenset[tuple[str, str]]:
    """What sets may have beside the names and say the same: what is fitted along, and what stands for that as well."""
    retuned, best = judgement.retuned, judgement.fit
    for_them = [key for effect in retuned for key in swapped(judgement.rivals, best, effect)]
    named = {effect.key for effect in judgement.named}
    return (unnamed(retuned, retuned, tunable) | frozenset(for_them)) - named


def _says_the_same(fit: Fit, judgement: Judgement, beside: frozenset[tuple[str, str]]) -> bool:
    """Whether a set has what is named and nothing else, but for what is fitted along and no name."""
    return bool(judgement.named and judgement.retuned) and fit.keys - beside == {
        effect.key for effect in judgement.named
    }


def least_certain(
    shooting: Shooting,
    fit: Fit,
    covariance: Array,
    before: str = _SETTLED,
    white: bool = True,
    named: Sequence[Effect] | None = None,
) -> tuple[list[Fit], Telling] | None:
    """A fit with its least certain parameter at either end of its interval, the others following.

    Args:
        shooting: the likelihood.
        fit: of a set.
        covariance: of its parameters, ``(P, P)``.
        before: what is said first, of the rivals.
        white: whether what is left is noise; else something is missing yet, and nobody says that the data are enough.
        named: effects whose parameters count; None for all.

    Returns:
        Two fits, and what telling them apart tells; None where no parameter is known at all.
    """
    flat, error = np.concatenate([np.zeros(0), *fit.values]), np.sqrt(np.maximum(np.diag(covariance), 0.0))
    relative = np.where((error > 0.0) & (flat != 0.0), error / np.abs(np.where(flat != 0.0, flat, 1.0)), 0.0)
    parameters = [(effect, parameter) for effect in fit.effects for parameter in effect.parameters]
    if named is not None:
        relative *= [effect in named for effect, _ in parameters]
    if not relative.any():
        return None
    place = int(np.argmax(relative))
    moved = _ENDS * covariance[:, place] / error[place]
    low, high = bounds(fit.effects)
    ends = [np.clip(flat + side * moved, low, high) for side in (-1.0, 1.0)]
    effect, parameter = parameters[place]
    known = parameter.name in effect.describe(fit.by_effect[effect])  # the sine of a cogging is no name for its users
    where = f"{effect.name} at {effect.target}"
    what = f"{parameter.name} of {where}"
    unit = "" if parameter.unit == "1" else f" {parameter.unit}".rstrip()
    enough = white and before == _SETTLED and relative[place] < _WELL_KNOWN
    before = f"nothing need be recorded: {before}" if enough else before

    def said(trial: Trial) -> tuple[str, bool]:
        share = float(left_of_errors(shooting, fit, trial.run, trial.start)[place])
        if share > _HARDLY_LESS:
            return f"{before}, and these controls would tell hardly more of {where}", False
        if not known:
            least = f"least certain is {where}, whose standard errors these controls would bring to about"
            return f"{before}; {least} {100 * share:.2g} % of what they are", not enough
        least = f"the least certain number is the {what}, whose standard error these controls would bring from"
        return f"{before}; {least} {error[place]:.2g}{unit} to about {share * error[place]:.2g}{unit}", not enough

    fits = [dataclasses.replace(fit, values=split(fit.effects, end)) for end in ends]
    if known:
        separates = [f"{what} {end[place]:.4g}{unit}" for end in ends]
    else:
        separates = [f"{where} at {end} end of its intervals" for end in ("one", "the other")]
    return fits, Telling(separates, said)
