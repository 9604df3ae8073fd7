"""A name beside others that leave much, and that does nothing for the forecast of held-out runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.findings.verdict import Verdict, decide, without_name
from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.selection.adequacy import LOUD
from torch_activegp.diagnosis.selection.compared import without_each
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.selection.process_left import by_positions
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.effect import Effect

_AS_WELL = 1.01
"""Times the errors of forecasts with all names that those without one may leave. On a real motor, whose friction left
450 times the noise, an encoder's gain of 1.02 took a third of that away, and left free runs as they were."""
_KINDS = ("free_run", "one_step")
_WORK = 5e6
"""Time steps for the fits without each name."""


def without_idle(explanation: Explanation, chosen: Fit, runs: Sequence[Run]) -> tuple[Explanation, Verdict] | None:
    """What is said without a name that is idle; None where none is.

    Where names leave much more than noise, what is left is something that nobody knows, and one more law of any shape
    makes a little of it. Held-out runs choose no name: they can only take one back.

    Args:
        explanation: the sets.
        chosen: the set that would be named.
        runs: the held-out ones.
    """
    effect = _idle(explanation, chosen, runs)
    if effect is None:
        return None
    selection, shooting = explanation.selection, explanation.shooting
    fewer = without_name(shooting, selection, effect.key, explanation.effects)
    verdict = decide(shooting, fewer, explanation.effects)
    note = (
        f"{effect.name} at {effect.target} would fit these recordings better, but what is left is much more than "
        "noise, and the held-out ones are forecast as well without it. It is not named."
    )
    return dataclasses.replace(explanation, selection=fewer), verdict._replace(notes=(*verdict.notes, note))


def _idle(explanation: Explanation, chosen: Fit, runs: Sequence[Run]) -> Effect | None:
    """The name without which the least is lost, of those without which forecasts of both kinds are as good."""
    shooting, selection = explanation.shooting, explanation.selection
    if len(chosen.effects) < 2 or by_positions(shooting, chosen)[1].chi2 < LOUD * shooting.dof:
        return None
    rests = without_each(selection, shooting, chosen.effects, shooting.work + _WORK)
    engine = explanation.engine.without_leapfrog()
    names = [str(number) for number in range(len(rests))]
    fits = dict(zip([*names, "all"], [*(rest for _, rest in rests), chosen], strict=True))
    models = {name: (engine, fit.candidate) for name, fit in fits.items()}
    errors, _ = compare(models, runs, engine.channels.joints, shooting.noise)
    as_well = [n for n in names if all(errors[kind][n] <= _AS_WELL * errors[kind]["all"] for kind in _KINDS)]
    return rests[int(min(as_well, key=lambda name: fits[name].chi2))][0] if as_well else None
