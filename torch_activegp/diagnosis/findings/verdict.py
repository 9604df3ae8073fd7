"""The verdict with a second opinion: a name has to forecast recordings that its parameters have not seen."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from torch_activegp.diagnosis.findings.rounded_clock import rounded_clock
from torch_activegp.diagnosis.findings.stability import stability
from torch_activegp.diagnosis.result import Stability
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.judge import Judgement, judge
from torch_activegp.diagnosis.selection.one_law import with_one_law
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.effect import Effect


class Verdict(NamedTuple):
    """What may be said, and why.

    Args:
        judgement: the verdict.
        stability: what becomes of its names when each recording is left out; None where nothing is named.
        notes: names that were given up, in sentences.
        unforeseen: that the held-out runs alone show a mismatch, in words; empty where the others do too, or none does.
        clock: that the rounded clock may have left all that is more than noise, in a sentence; empty where it did not.
    """

    judgement: Judgement
    stability: Stability | None
    notes: tuple[str, ...]
    unforeseen: str = ""
    clock: str = ""


def decide(shooting: Shooting, selection: Selection, effects: Sequence[Effect]) -> Verdict:
    """Judges, and judges again without the sets of a name that leaving recordings out refutes, one name at a time.

    A score on all data takes noise for independent. Where it is not (a coarse encoder at slow motion), some law of many
    shapes may explain a little of it; such a law makes the forecasts of recordings left out worse.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
        effects: what was tried.
    """
    notes: list[str] = []
    while True:
        judgement = judge(shooting, selection)
        found = stability(shooting, selection, judgement)
        refuted = [effect for effect in (found.effects if found is not None else ()) if effect.refuted]
        if not refuted:
            nameless = judgement.verdict == "unknown" and not judgement.named
            clock = rounded_clock(shooting, selection.nominal) if nameless else ""
            if clock:
                judgement = dataclasses.replace(judgement, verdict="none", unexplained=0.0)
            return Verdict(judgement, found, tuple(notes), clock=clock)
        worst = min(refuted, key=lambda effect: sum(gain or 0.0 for gain in effect.gains))
        lost = sum((gain or 0.0) < 0.0 for gain in worst.gains)
        notes.append(
            f"{worst.name} at {worst.target} would fit these recordings better, but by chance: fitted to the others, "
            f"it makes the forecasts of {lost} of the {len(worst.gains)} recordings left out worse. It is not named."
        )
        selection = without_name(shooting, selection, (worst.name, worst.target), effects)
        selection.score = selection.score.without_free()


def without_name(
    shooting: Shooting, selection: Selection, key: tuple[str, str], effects: Sequence[Effect]
) -> Selection:
    """The sets without a name at a target, with one law then for a friction that is about as large both ways.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
        key: name and target.
        effects: what was tried.
    """
    return with_one_law(shooting, selection.without(key, shooting.dof), effects)
