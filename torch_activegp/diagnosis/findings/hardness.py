"""How hard what is struck may be, where the recordings hardly tell."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from torch_activegp.diagnosis.findings.open_forms import AS_WELL, widened
from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.result import Estimate
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.physics.effect import Effect

_ROUNDS, _WORK = 20, 5e6
"""Of the fits, and time steps of them all from which on they end."""
_MARGIN = 1.0
"""So many times as deep as a stop is pushed in, before it: segments that come so near tell of it."""


def with_hardness(
    shooting: Shooting, fit: Fit, effect: Effect, own: Mapping[str, Estimate], scale: float
) -> dict[str, Estimate]:
    """Estimates of what is struck, with intervals that hold what is softer or harder and fits as well.

    Where a stop is touched for a row or two, one 30 times as stiff and 13 mrad further out leaves the same: the valley
    between them is curved, and the derivatives at one end of it do not show the other. The profile of the likelihood
    is taken at a few hardnesses, from fits to the segments that come near; each parameter's interval there is
    that with the others held.

    Args:
        shooting: the likelihood by which the set has its numbers.
        fit: the set.
        effect: of it.
        own: its estimates.
        scale: variance of the noise in units of the noise model.

    Reference: Raue et al., *Structural and Practical Identifiability Analysis of Partially Observed Dynamical Models by
    Exploiting the Profile Likelihood*, Bioinformatics 25 (2009).
    """
    values = fit.by_effect[effect]
    others = effect.as_hard(values)
    near = np.flatnonzero(_near(shooting, effect, values)) if others else np.zeros(0, dtype=np.int64)
    if not near.size:
        return dict(own)
    part = shooting.pick(near)
    sets = [(fit.effects, [one if e is effect else v for e, v in fit.by_effect.items()]) for one in (values, *others)]
    here, *ends = part.fit(sets, fit.starts[near], _ROUNDS, work=part.work + _WORK)
    as_well = [end for end in ends if end.plausible and end.chi2 < here.chi2 + AS_WELL * scale]
    held = [dataclasses.replace(end, information=np.diag(np.diag(end.information))) for end in as_well]
    return widened(part, own, [(effect, end) for end in held if end.is_known])[0]


def _near(shooting: Shooting, effect: Effect, values: Array) -> Array:
    """The segments in which a joint comes near the place from which on an effect acts, ``(S,)``."""
    acting, segments = effect.acts(values), shooting.segments
    assert acting is not None
    ((low, high),) = acting.within
    position = segments.take("smooth")[..., shooting.engine.channels.joints.index(acting.joint)]
    beyond = np.where(segments.counts, position - low if np.isfinite(low) else high - position, -np.inf)
    return np.asarray(beyond.max(axis=1) > -_MARGIN * max(float(beyond.max()), 0.0))
