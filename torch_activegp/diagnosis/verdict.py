"""The verdict with a second opinion: a name has to forecast recordings that its parameters have not seen."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

from torch_activegp.diagnosis.compared import Selection
from torch_activegp.diagnosis.judge import Judgement, judge
from torch_activegp.diagnosis.result import Stability
from torch_activegp.diagnosis.shooting import Shooting
from torch_activegp.diagnosis.stability import stability


class Verdict(NamedTuple):
    """What may be said, and why.

    Args:
        judgement: the verdict.
        stability: what becomes of its names when each recording is left out; None where nothing is named.
        selection: the sets that it was chosen from.
    """

    judgement: Judgement
    stability: Stability | None
    selection: Selection


def decide(shooting: Shooting, selection: Selection) -> Verdict:
    """Judges, and judges again without the sets of a name that leaving recordings out refutes.

    A score on all data takes noise for independent. Where it is not (a coarse encoder at slow motion), some law of many
    shapes may explain a little of it; such a law makes the forecasts of recordings left out worse.

    Args:
        shooting: the likelihood.
        selection: the compared sets.
    """
    while True:
        judgement = judge(shooting, selection)
        found = stability(shooting, selection, judgement)
        refuted = {(e.name, e.target) for e in (found.effects if found is not None else ()) if e.refuted}
        if not refuted:
            return Verdict(judgement, found, selection)
        fits = [fit for fit in selection.fits if not fit.keys & refuted]
        selection = dataclasses.replace(selection, fits=fits)
        selection.rescale(shooting.dof)
