"""Entries of ``diagnosis.json``: named effects, what was fitted along, rivals, recordings."""

from __future__ import annotations

from typing import Any

import numpy as np

from torch_activegp.diagnosis.findings.hardness import with_hardness
from torch_activegp.diagnosis.findings.open_forms import open_forms, widened
from torch_activegp.diagnosis.findings.short_steps import Numbers
from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.result import NamedEffect
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.selection.intervals import estimates, unit_of
from torch_activegp.diagnosis.selection.judge import Judgement
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.effect import Effect

_SHOWN = 8
"""So many rivals are reported, and the nominal."""


def named_effects(
    explanation: Explanation, judgement: Judgement, held: dict[Any, bool | None], numbers: Numbers
) -> tuple[tuple[NamedEffect, ...], list[str]]:
    """The named effects, if there are any, and notes on those of which the recordings do not tell the form.

    Args:
        explanation: what was found, and how.
        judgement: what may be said of it.
        held: of each effect, whether MJCF holds it.
        numbers: the chosen set, with the parameters to be given.
    """
    if judgement.verdict not in ("named", "tie"):
        return (), []
    named, notes = [], []
    for effect, share, probability, ties in zip(
        judgement.named, judgement.shares, judgement.probabilities, judgement.ties, strict=True
    ):
        values = numbers.fit.by_effect[effect]
        own = estimates(explanation.shooting, numbers.fit, effect)
        own = with_hardness(numbers.shooting, numbers.fit, effect, own, explanation.selection.score.scale)
        forms = open_forms(explanation.selection, judgement.fit, effect) if numbers.fit is judgement.fit else []
        parameters, wider = widened(explanation.shooting, own, forms)
        law, large = effect.law_with(values), effect.too_much(values)
        mjcf = held.get(effect, False)
        named.append(NamedEffect(effect.name, effect.target, law, share, probability, parameters, ties, mjcf, large))
        laws = dict.fromkeys(form.law_with(fit.by_effect[form]) for form, fit in forms if form in wider)
        if others := [one for one in laws if one != law]:
            notes.append(
                f"{effect.name} at {effect.target}: the recordings fit as well with {', or with '.join(others)}. Its "
                "interval spans all these; its value is for the law that is given."
            )
    return tuple(named), notes


def retuned_entries(explanation: Explanation, judgement: Judgement, numbers: Fit) -> list[dict[str, Any]]:
    """What goes into the correction without a name; see :func:`named_effects`."""
    out = []
    for effect in judgement.retuned if judgement.verdict in ("named", "tie") else ():
        values = estimates(explanation.shooting, numbers, effect)
        parameters = {k: {"value": e.value, "unit": e.unit, "ci95": list(e.ci95)} for k, e in values.items()}
        out.append({"name": effect.name, "target": effect.target, "parameters": parameters})
    return out


def rival_entries(explanation: Explanation, judgement: Judgement) -> list[dict[str, Any]]:
    """The sets that came closest, with their numbers, and the nominal."""
    dof = explanation.shooting.dof
    within = explanation.selection.within  # a set that was given up in a race fits worse than a part of itself
    ended = [rival for rival in judgement.rivals if rival[0] is judgement.fit or within(rival[0]) is None]
    shown = [rival for i, rival in enumerate(ended) if i < _SHOWN or not rival[0].effects]
    return [
        {
            "effects": [
                {"name": effect.name, "target": effect.target, "parameters": _numbers(effect, values)}
                for effect, values in zip(fit.effects, fit.values, strict=True)
            ],
            "chi2_per_dof": fit.chi2 / max(dof - fit.size, 1),
            "delta_bic": distance,
            "probability": weight,
        }
        for fit, distance, weight in shown
    ]


def _numbers(effect: Effect, values: Array) -> dict[str, dict[str, Any]]:
    """Parameters as their users know them, without intervals."""
    described = effect.describe(values)
    return {
        name: {"value": float(value), "unit": unit_of(effect, name, i)}
        for i, (name, value) in enumerate(described.items())
    }


def recording_entries(machine: Machine) -> list[dict[str, Any]]:
    """What was recorded, and what was decided about each recording."""
    return [
        {
            "name": run.label,
            "role": role,
            "rows": int(run.counted.sum()),
            "seconds": float(run.time[-1]),
            "rate_hz": float(1.0 / np.median(np.diff(run.time[run.recorded]))),
            "notes": [
                note.removeprefix(f"{run.label}: ") for note in machine.notes if note.startswith(f"{run.label}: ")
            ],
        }
        for role, runs in (("fit", machine.fit), ("holdout", machine.holdout))
        for run in runs
    ]
