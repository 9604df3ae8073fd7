"""Initial states from the segment before, or at rest: ways out where the smoothed recording misleads."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.point import total
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.shooting import Shooting

_STANDS_OUT = 3.0
"""A segment stands out by so many times the median chi2 of a sample, and so much at least."""
_ROUNDS = 3
_STEPS = 8
_BETTER = 0.5
_CREEPS = 0.1
"""Part of its top speed below which a joint may be at rest where a smoothed recording has it moving."""


def chained(shooting: Shooting, fit: Fit) -> Fit:
    """The fit with segments that stand out begun where the segments before them lead, or at rest, where that is better.

    The speed at an impact is not what a smoothed recording shows, and no derivative leads from one side of an impact to
    the other. The simulation of the segment before knows on which side the machine was. Nor does one lead to a joint
    that dry friction holds: a smoothed recording shows it creeping.

    Args:
        shooting: the likelihood.
        fit: of any set.
    """
    segments, before, arrived = shooting.segments, fit, fit.starts
    for number in range(_ROUNDS):
        level = fit.per_segment / segments.samples
        out = level > _STANDS_OUT * max(float(np.median(level)), 1.0)
        if not out.any():
            break
        known, arrives = fit, _continued(shooting, fit)
        elsewhere = (arrives != arrived).any(axis=1) & (arrives != fit.starts).any(axis=1)
        fit = _tried(shooting, fit, out & elsewhere, arrives)
        for still, where in [] if number else _at_rest(shooting):  # the same again in later rounds
            fit = _tried(shooting, fit, out & where, still)
        if fit is known:
            break
        arrived = arrives
    return shooting.fit([(fit.effects, fit.values)], fit.starts)[0] if fit is not before and fit.effects else fit


def _tried(shooting: Shooting, fit: Fit, where: NDArray[np.bool_], starts: Array) -> Fit:
    """The fit with some of its segments ``(S,)`` begun at some states ``(S, n)`` where that is better."""
    if not where.any():
        return fit
    which = np.flatnonzero(where)
    other = shooting.pick(which).fit([(fit.effects, fit.values)], starts[which], rounds=_STEPS, hold=True)[0]
    better = other.per_segment < fit.per_segment[which] - _BETTER
    return _with(fit, which[better], other.pick(better)) if better.any() else fit


def _with(fit: Fit, which: NDArray[np.int64], part: Fit) -> Fit:
    """A fit with some of its segments begun elsewhere."""
    columns = {}
    for name in ("starts", "per_segment", "design"):
        columns[name] = getattr(fit, name).copy()
        columns[name][which] = getattr(part, name)
    return dataclasses.replace(fit, chi2=total(columns["per_segment"]), columns=None, **columns)


def _continued(shooting: Shooting, fit: Fit) -> Array:
    """The states at which the segments before arrive, ``(S, n)``; where there is none, those of the fit."""
    segments, starts = shooting.segments, fit.starts.copy()
    along = shooting.engine.trajectories(segments, fit.starts, fit.candidate)
    for s in range(1, segments.size):
        rows = segments.first[s] - segments.first[s - 1]
        if segments.run[s] == segments.run[s - 1] and 0 < rows <= segments.intervals:
            starts[s] = along[s - 1, rows]
    return np.where(np.isfinite(starts), starts, fit.starts)


def _at_rest(shooting: Shooting) -> list[tuple[Array, NDArray[np.bool_]]]:
    """The smoothed recording with all joints at rest that creep, and with each where several do.

    Returns:
        States ``(S, n)``, and in which segments they are at rest, ``(S,)``.
    """
    smooth, nq = shooting.engine.starts(shooting.segments), shooting.engine.model.nq
    dofs = nq + np.asarray(shooting.engine.channels.dof)
    creeps = np.abs(smooth[:, dofs]) < _CREEPS * shooting.state_reach()[dofs]
    several = creeps.sum(axis=1) > 1
    masks = [creeps, *(creeps & several[:, None] & (dofs == dof) for dof in dofs)]
    out = []
    for still in (mask for mask in masks if mask.any()):
        states = smooth.copy()
        states[:, dofs] = np.where(still, 0.0, smooth[:, dofs])
        out.append((states, still.any(axis=1)))
    return out
