"""Forms of a named effect between which the recordings do not decide: its numbers are open as well."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from scipy import stats

from torch_activegp.diagnosis.result import Estimate
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.intervals import estimates
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.effect import Effect

AS_WELL = float(stats.chi2.ppf(0.95, 1))
"""Chi2 by which a form may fit worse for its parameters to be within 95 %."""
_WIDER = 1.2
"""An interval that is so many times as wide is worth a note."""


Form = tuple[Effect, Fit]
"""One form of an effect, and a set that holds it in place of another one."""


def open_forms(selection: Selection, fit: Fit, effect: Effect) -> list[Form]:
    """Other forms of an effect with which a set fits as well.

    A load on the first link of an arm that lies flat turns about one axis: a mass at the link's centre does what a
    fourth of it does at its end. Forms with more parameters are left out: a place that is free leaves every mass open,
    where the recordings gain nothing by it.

    Args:
        selection: the compared sets.
        fit: the chosen set.
        effect: of it.
    """
    others = set(fit.effects) - {effect}
    found: dict[Effect, Fit] = {}
    for rival in sorted(selection.fits, key=lambda one: one.chi2):
        rest = set(rival.effects) - others
        if len(rival.effects) != len(fit.effects) or len(rest) != 1 or rival.at_rest or not rival.plausible:
            continue
        form = rest.pop()
        other = form is not effect and form.key == effect.key and len(form.parameters) <= len(effect.parameters)
        if other and rival.chi2 - fit.chi2 < AS_WELL * selection.score.scale:
            found.setdefault(form, rival)
    return list(found.items())


def widened(
    shooting: Shooting, own: Mapping[str, Estimate], forms: Sequence[Form]
) -> tuple[dict[str, Estimate], list[Effect]]:
    """Estimates whose intervals hold those of other forms, and the forms that make them much wider.

    Args:
        shooting: the likelihood.
        own: estimates of the chosen form.
        forms: the others.
    """
    out, wider = dict(own), dict[Effect, None]()
    for form, fit in forms:
        for name, other in estimates(shooting, fit, form).items():
            if name not in own or own[name].unit != other.unit:
                continue
            low, high = own[name].ci95
            if max(high, other.ci95[1]) - min(low, other.ci95[0]) > _WIDER * (high - low):
                wider[form] = None
            low, high = out[name].ci95
            out[name] = dataclasses.replace(out[name], ci95=(min(low, other.ci95[0]), max(high, other.ci95[1])))
    return out, list(wider)
