"""A name beside others that leave much, and that does nothing for the forecast of held-out runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.findings.verdict import Verdict, decide
from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.selection.adequacy import LOUD
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.selection.process_left import by_positions
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.effect import Effect

_AS_WELL = 1.01
"""Times the errors of forecasts with all names that those without one may leave. On a real motor, whose friction left
450 times the noise, an encoder's gain of 1.02 took a third of that away, and left free runs as they were."""


def without_idle(
    explanation: Explanation, chosen: Fit, holdout: Mapping[str, Any], runs: Sequence[Run]
) -> tuple[Explanation, Verdict] | None:
    """What is said without a name that is idle; None where none is.

    Where names leave much more than noise, what is left is something that nobody knows, and one more law of any shape
    makes a little of it. Held-out runs choose no name: they can only take one back.

    Args:
        explanation: the sets.
        chosen: the set that would be named.
        holdout: its errors on the held-out runs, ``after``.
        runs: these.
    """
    effect = _idle(explanation, chosen, holdout, runs)
    if effect is None:
        return None
    selection, shooting = explanation.selection, explanation.shooting
    fewer = selection.without(effect.key, shooting.dof)
    verdict = decide(shooting, fewer)
    note = (
        f"{effect.name} at {effect.target} would fit these recordings better, but what is left is much more than "
        "noise, and the held-out ones are forecast as well without it. It is not named."
    )
    return dataclasses.replace(explanation, selection=fewer), verdict._replace(notes=(*verdict.notes, note))


def _idle(explanation: Explanation, chosen: Fit, holdout: Mapping[str, Any], runs: Sequence[Run]) -> Effect | None:
    """The name without which the least is lost, of those without which forecasts of both kinds are as good."""
    shooting, selection = explanation.shooting, explanation.selection
    if len(chosen.effects) < 2 or by_positions(shooting, chosen)[1].chi2 < LOUD * shooting.dof:
        return None
    rests = {e: selection.of([other for other in chosen.effects if other is not e]) for e in chosen.effects}
    known = {str(number): (e, fit) for number, (e, fit) in enumerate(rests.items()) if fit is not None}
    if not known:
        return None
    engine = explanation.engine.without_leapfrog()
    models = {name: (engine, fit.candidate) for name, (_, fit) in known.items()}
    errors, _ = compare(models, runs, engine.channels.joints, shooting.noise)
    kinds = ("free_run", "one_step")
    idle = [n for n in known if all(errors[kind][n] <= _AS_WELL * holdout[kind]["after"] for kind in kinds)]
    return known[min(idle, key=lambda name: known[name][1].chi2)][0] if idle else None
