"""Initial states from the segment before, at rest, or of another fit: ways out where derivatives lead nowhere."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import ROUNDS, Shooting
from torch_activegp.diagnosis.shooting.point import total

_STANDS_OUT = 3.0
"""A segment stands out by so many times the median chi2 of a sample, and so much at least."""
_STANDS_OUT_OF_NOISE, _NEAR_NOISE = 1.4, 1.5
"""The same where the usual ones leave hardly more than noise: a joint that friction held as they began left one of 258
samples at 2.4, and two such segments of 51 hid a damping, and looked like a delay; noise left no more than 1.3."""
_ROUNDS = 3
_STEPS = 8
_BETTER = 0.5


def chained(shooting: Shooting, fit: Fit, rest: bool = True, rounds: int = ROUNDS) -> Fit:
    """The fit with segments that stand out begun where the segments before them lead, or at rest, where that is better.

    The speed at an impact is not what a smoothed recording shows, and no derivative leads from one side of an impact to
    the other. The simulation of the segment before knows on which side the machine was. Nor does one lead to a joint
    that dry friction holds: a smoothed recording shows it creeping.

    Args:
        shooting: the likelihood.
        fit: of any set.
        rest: whether it is begun at rest too.
        rounds: of the fit to all segments in the end, at most.
    """
    before = fit
    for number in range(_ROUNDS):
        out = stands_out(shooting, fit)
        if not out.any() or fit.design is None:
            break
        known = fit
        ways = [_continued(shooting, fit), *(_at_rest(shooting) if rest and not number else [])]  # later ends as before
        fit = _tried(shooting, fit, out, ways)
        if fit is known:
            break
    if fit is before or not fit.effects:
        return fit
    return shooting.fit([(fit.effects, fit.values)], fit.starts, rounds, near=fit)[0]


def stands_out(shooting: Shooting, fit: Fit) -> NDArray[np.bool_]:
    """Segments that a fit explains worse than the usual ones by far, ``(S,)``."""
    level = fit.per_segment / shooting.segments.samples
    usual = max(float(np.median(level)), 1.0)
    return level > (_STANDS_OUT_OF_NOISE if usual < _NEAR_NOISE else _STANDS_OUT) * usual


def borrowed(shooting: Shooting, fit: Fit, other: Fit) -> Fit:
    """The fit with segments that another set fits better begun where that begins them, where it is better; fitted anew.

    On a machine that strikes fits of nearly the same end on different sides of impacts, each in other segments: a lag
    left 174 more than a lag and a friction, and with the states of three segments from there 17.

    Args:
        shooting: the likelihood.
        fit: of any set.
        other: of another one, to the same segments.
    """
    worse = fit.per_segment > other.per_segment + _BETTER
    if not worse.any():
        return fit
    found = _tried(shooting, fit, worse, [other.starts])
    if found is fit or not fit.effects:
        return found
    return min(found, shooting.fit([(fit.effects, fit.values)], found.starts, near=found)[0], key=lambda one: one.chi2)


def passed(shooting: Shooting, fit: Fit, segments: Segments) -> Array:
    """The states ``(S, n)`` that a fit passes where other segments begin; a smoothed recording's where it does not.

    Args:
        shooting: the likelihood of the fit.
        fit: of any set.
        segments: the others, S of them.
    """
    known, engine = shooting.segments, shooting.engine
    starts, along = engine.starts(segments), engine.trajectories(known, fit.starts, fit.candidate)
    for s, (run, first) in enumerate(zip(segments.run, segments.first, strict=True)):
        there = np.flatnonzero((known.run == run) & (known.first <= first) & (first <= known.scored[:, 1]))
        state = along[there[-1], first - known.first[there[-1]]] if len(there) else starts[s]
        starts[s] = state if np.isfinite(state).all() else starts[s]
    return starts


def _tried(shooting: Shooting, fit: Fit, where: NDArray[np.bool_], ways: Sequence[Array]) -> Fit:
    """The fit with some of its segments ``(S,)`` begun at states ``(S, n)``, any of several ways, where that is better.

    They are tried side by side: a few segments of a machine that stops in each time step take as long as many.
    """
    which = np.flatnonzero(where)
    sets, starts = [(fit.effects, fit.values)] * len(ways), np.stack([states[which] for states in ways])
    near = dataclasses.replace(fit, columns=None).pick(which)
    for other in shooting.pick(which).fit(sets, starts, rounds=_STEPS, hold=True, near=near):
        better = other.per_segment < fit.per_segment[which] - _BETTER
        fit = _with(fit, which[better], other.pick(better)) if better.any() else fit
    return fit


def _with(fit: Fit, which: NDArray[np.int64], part: Fit) -> Fit:
    """A fit with some of its segments begun elsewhere."""
    columns = {}
    for name in ("starts", "per_segment", "design"):
        if getattr(fit, name) is not None:
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


def _at_rest(shooting: Shooting) -> list[Array]:
    """The smoothed recording with all joints at rest, and with each of several, ``(S, n)``."""
    smooth, dofs = shooting.engine.starts(shooting.segments), shooting.engine.channels.dof
    out = []
    for still in [dofs, *([dof] for dof in dofs if len(dofs) > 1)]:
        out.append(smooth.copy())
        out[-1][:, shooting.engine.model.nq + np.asarray(still)] = 0.0
    return out
