"""A mismatch in one place: what acts only somewhere, and was hardly met, is little of all that was recorded."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.preparation.noise_left import by_segment
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.touching import touching, widened

_FAR = 5.0
"""Times the noise, and what the median segment leaves, that one stands out by: 2.5 at most on 110 machines on which
noise alone was left. A pocket of negative damping that was met once left 16 in one segment, and 1.25 in all."""
_UNSTEADY = 8.0
"""Times what chance makes of it, by which what is left varies from segment to segment: 3.5 at most behind 22 machines
with noise alone, where a clock jittered. A magnet that a pendulum at 50 Hz passed between two rows left 22, and 1.35
times the noise."""
_SEGMENTS, _VALUES = 10, 9
"""Segments at least, and values in each, that tell how much it varies."""


def stands_out(shooting: Shooting, fit: Fit, louder: float) -> bool:
    """Whether a fit leaves far more in some segment than in most, and nothing is about to touch there.

    Where something is, an instant of contact that is a little off leaves as much.

    Args:
        shooting: the likelihood.
        fit: of any set.
        louder: by how much noise may be louder than its floor, in chi2 per degree of freedom.
    """
    each = fit.per_segment / shooting.segments.samples
    far = np.flatnonzero(each > _FAR * (1.0 + louder) * max(float(np.median(each)), 1.0))
    return not _touches(shooting, far).all()


def comes_and_goes(shooting: Shooting, fit: Fit) -> bool:
    """Whether what a fit leaves is louder in some segments than in others, as noise is not, where nothing touches.

    However loud noise is, and whatever filtered it, it is so always; but for a video's, which is of who marks a frame,
    and, by less, that of a clock whose rows are late by more or less. That tells a mismatch from it where neither its
    level nor its colour is known.

    Args:
        shooting: the likelihood.
        fit: of any set.
    """
    if any(run.video for run in shooting.segments.runs):
        return False
    power, counts = by_segment(shooting, fit)
    some = np.flatnonzero(counts >= _VALUES)
    if _unsteadiness(power[:, some], counts[some]) < _UNSTEADY:
        return False
    free = some[~_touches(shooting, some)]
    return _unsteadiness(power[:, free], counts[free]) >= _UNSTEADY


def _unsteadiness(power: Array, counts: NDArray[np.int64]) -> float:
    """How much more sums of squares ``(C, S)`` of so many values ``(S,)`` rise above the usual than those of noise do.

    That is about one for noise, give or take the root of five over S; zero for few segments. What is less than the
    noise is not counted: a quantised encoder at rest leaves nothing.
    """
    if len(counts) < _SEGMENTS or not len(power):
        return 0.0
    usual = np.maximum(power.sum(axis=1, keepdims=True) / counts.sum(), 1.0)
    above = np.maximum(power / (counts * usual) - 1.0, 0.0)
    return float((counts * above**2).mean(axis=1).max())


def _touches(shooting: Shooting, which: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether something is about to touch in some segments, ``(n,)``."""
    if not len(which):
        return np.zeros(0, dtype=bool)
    segments, wide = shooting.segments, widened(shooting.engine.model)

    def touches(number: int) -> bool:
        rows = np.arange(segments.first[number], segments.scored[number, 1] + 1)
        return bool(touching(wide, shooting.engine.channels, segments.runs[segments.run[number]], rows).any())

    return np.array([touches(number) for number in which])
