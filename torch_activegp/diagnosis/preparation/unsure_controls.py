"""Controls that are not quite known, in missing rows or by a rounded clock: how far they move simulations."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.rounded_times import rounding
from torch_activegp.diagnosis.inputs.runs import Array, Run
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.preparation.rivals import beside
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_MUCH = 0.05
"""Chi2 per degree of freedom by which controls that are off may move a segment."""
_MIDDLE = (1 / 3, 2 / 3)
"""Where in a segment a gap may be to cut it there: nearer to an end one piece would be too short."""


def unsure(shooting: Shooting, fit: Fit) -> NDArray[np.bool_]:
    """The segments in which controls may be off by what moves more than initial states make up for, ``(S,)``.

    Each lost row leaves a small leap of the speed, and so does a time that was rounded at uneven rows, for a control
    acts as long as the clock says. That counts the more the longer a simulation goes on: in segments of 1 s an arm of
    six joints whose controller reacts to every row left 1.4 times the noise with 3 % of the rows lost, and one of two
    joints 1.3 times by a clock in steps of 0.1 ms, as if something were missing; in 0.25 s the noise alone. What a
    rounded time moves its own row by is not looked at.

    Args:
        shooting: the likelihood.
        fit: with derivatives by the initial states.
    """
    segments = shooting.segments
    off = [_off(run) for run in segments.runs]
    if not any(one.any() for one in off):
        return np.zeros(segments.size, dtype=bool)
    runs = (dataclasses.replace(run, control=run.control + one) for run, one in zip(segments.runs, off, strict=True))
    other = dataclasses.replace(shooting, segments=dataclasses.replace(segments, runs=tuple(runs)))
    assert fit.design is not None
    one, another = other.predicted(fit), shooting.predicted(fit)
    apart = np.nan_to_num(shooting.noise.whiten(segments, one - another))
    moved = (beside(fit.design, apart) ** 2).sum(axis=1)
    fails = np.isnan(one).any(axis=(1, 2)) != np.isnan(another).any(axis=(1, 2))
    return np.asarray((moved > _MUCH * segments.samples) | fails)


def _off(run: Run) -> Array:
    """By how much the mean control of each interval may be off, ``(K, nu)``; errors of rounding are drawn."""
    guessed, step = np.zeros_like(run.control) if run.unsure is None else run.unsure, rounding(run)
    if not step:
        return guessed
    late = step * np.random.default_rng(0).uniform(-0.5, 0.5, (len(run.control), 1))
    return np.asarray(guessed - np.diff(run.control, axis=0, prepend=run.control[:1]) * late / run.dt[:, None])


def behind_gaps(segments: Segments) -> Array:
    """The part of each segment up to the end of the gap nearest to its middle, ``(S,)``; a half where none is near.

    So neither piece has that gap within: the first one counts no row behind it, the second none before its end.
    """
    shares = np.full(segments.size, 0.5)
    for s, (number, (first, last)) in enumerate(zip(segments.run, segments.scored, strict=True)):
        recorded = segments.runs[number].recorded
        behind = 1 + np.flatnonzero(recorded[first + 1 : last] & ~recorded[first : last - 1])
        part = (behind + 0.5) / (last - first)
        part = part[(part > _MIDDLE[0]) & (part < _MIDDLE[1])]
        if len(part):
            shares[s] = part[np.argmin(np.abs(part - 0.5))]
    return shares
