"""Controls of rows that a recording misses are guesses: how far they move a simulation, and where to cut it."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.preparation.rivals import beside
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_MUCH = 0.05
"""Chi2 per degree of freedom by which guesses may be wrong in a segment."""


def unsure(shooting: Shooting, fit: Fit) -> NDArray[np.bool_]:
    """The segments in which guessed controls may move what no initial state makes up for, ``(S,)``.

    Each lost row leaves a small leap of the speed, which counts the more the longer a simulation goes on. An arm of six
    joints under a controller left 1.4 times the noise so in segments of 1 s, as if something were missing.

    Args:
        shooting: the likelihood.
        fit: with derivatives by the initial states.
    """
    segments = shooting.segments
    if all(run.unsure is None for run in segments.runs):
        return np.zeros(segments.size, dtype=bool)
    runs = (
        run if run.unsure is None else dataclasses.replace(run, control=run.control + run.unsure)
        for run in segments.runs
    )
    other = dataclasses.replace(shooting, segments=dataclasses.replace(segments, runs=tuple(runs)))
    assert fit.design is not None
    apart = np.nan_to_num(shooting.noise.whiten(segments, other.predicted(fit) - shooting.predicted(fit)))
    moved = (beside(fit.design, apart) ** 2).sum(axis=1)
    return np.asarray(moved > _MUCH * segments.samples)


def behind_gaps(segments: Segments) -> Array:
    """The part of each segment that ends with the gap nearest to its middle, ``(S,)``; a half where there is none.

    So neither piece has that gap within: the first one counts no row behind it, the second begins there.
    """
    shares = np.full(segments.size, 0.5)
    for s, (number, (first, last)) in enumerate(zip(segments.run, segments.scored, strict=True)):
        recorded = segments.runs[number].recorded
        behind = 1 + first + np.flatnonzero(recorded[first + 1 : last] & ~recorded[first : last - 1])
        if len(behind):
            nearest = behind[np.argmin(np.abs(behind - 0.5 * (first + last)))]
            shares[s] = (nearest - first + 0.5) / (last - first)
    return shares
