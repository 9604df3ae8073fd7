"""Integrators of a simulator that recordings may have been made with: in steps of which length each comes closest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.preparation.rivals import Rival, closest_by_one
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.calm import is_abrupt
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.forms import FEW_SHORTER, Forms

MUCH = 2.0
"""Times the noise from which on much is left, and what absorbs some of it may do so by chance."""
DISCRETE = 0.03
"""Part of chi2 by which the model's own time steps must fit better: a machine has none. Dry friction of 0.12 N m was
found as 0.1165 with steps of 2.5 ms that fitted one run better by a fortieth of its chi2."""
NO_FARTHER = 1.1
"""How much more than the other forms the best may leave to be fitted: it must be better where much is left, by what it
costs. Where something touches, any form than the best one in brief pieces."""
_GLANCE = 6
"""Segments on which the model's own integrator is tried in steps of several lengths where something sticks."""


def own_rivals(
    forms: Forms, own: Sequence[Engine], first: Shooting, rough: Fit, rivals: Sequence[Rival]
) -> list[Rival]:
    """Those of some forms in short steps that come closest, one of each scheme, where no other is closer by far.

    Args:
        forms: all forms of the model.
        own: some of their ``own``.
        first: the likelihood.
        rough: the fit at which they compete, with derivatives.
        rivals: the forms that compete with them; the fine one is among them.
    """
    schemes = dict.fromkeys(form.scheme for form in own)
    some = ([form for form in own if form.scheme == scheme] for scheme in schemes)
    return [rival for alike in some for rival in _closest(forms, alike, first, rough, rivals)]


def _closest(forms: Forms, own: Sequence[Engine], first: Shooting, rough: Fit, rivals: Sequence[Rival]) -> list[Rival]:
    """The one of some forms of one scheme, in steps of several lengths, if it is close enough."""
    left = min(rival.left for rival in rivals)
    least = left * (NO_FARTHER if left < MUCH * first.dof else 1.0 - DISCRETE)
    fails = any(rival.engine is forms.fine and not np.isfinite(rival.left) for rival in rivals)
    if any(is_abrupt(effect) for effect in rough.effects) or forms.firm is not None or fails:
        few, which = first.subset(_GLANCE / first.segments.size)
        some = [form for form in own if form.substeps // forms.given.substeps in FEW_SHORTER] or own
        closest = min(some, key=lambda form: Rival.at(few, form, rough.pick(which)).left)
        found = [Rival.at(first, closest, rough)]
    else:
        found = closest_by_one(own, rivals, forms.fine, first, rough, least)
    return [rival for rival in found[-1:] if rival.left < least]


def likeliest(forms: Forms, shooting: Shooting, fit: Fit) -> list[Engine]:
    """Of the forms in short steps, those that come closest behind a fit: one of each scheme, the closest first.

    Args:
        forms: all forms of the model.
        shooting: the likelihood, of one of them.
        fit: what they simulate, with derivatives.
    """
    rivals = [Rival.at(shooting, form, fit) for form in dict.fromkeys((shooting.engine, forms.fine))]
    own = [form for form in forms.own if form is not shooting.engine]
    found = own_rivals(forms, own, shooting, fit, rivals)
    return [rival.engine for rival in sorted(found, key=lambda rival: rival.left)]
