"""Segments of a machine that touches something in which its linearisation promises no more than is so."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.preparation.rivals import beside
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import Linearization
from torch_activegp.diagnosis.simulation.touching import strikes

_TIMES = 1.5
"""How much more a push may be foreseen to do than it does, and than it is in the median, as sums of squares: in three
of twelve segments it was 500 thousand, 3 and 1.6 times that, and at most 1.3 in the others."""
_LEAST = 10.0
"""Chi2 that a push makes at least, in the median."""


def smooth_segments(shooting: Shooting, fit: Fit, linear: Linearization) -> NDArray[np.int64]:
    """Those in which constant forces do as much as the linearisation foresees, half of them at least.

    All where nothing touches, and of a black box, of which nobody knows. At an impact finite differences are of any
    size, and one such segment outweighs all others in normal equations: on a leg that stands and hops one of twelve
    held 30 thousand times the information on a payload that the others did. These agreed on 0.22 kg that gained 13500;
    together they saw 0.0003 kg and a gain of 111, and four other names came first.

    Args:
        shooting: the likelihood.
        fit: to its S segments.
        linear: the machine's linearisation there.
    """
    engine, segments = shooting.differences, shooting.segments
    if not strikes(engine.model, engine.channels, segments.runs):
        return np.arange(segments.size)
    too_much = np.zeros(segments.size)
    start, before = shooting.whiten_columns(linear.respond_to_start()), _predicted(shooting, fit)
    held = np.ones((segments.size, segments.intervals, 1))
    left = max(float(np.median(fit.per_segment - segments.samples)), _LEAST)
    for channel, dof in enumerate(engine.channels.dof):
        unit = beside(start, shooting.whiten_columns(linear.respond_to_force(channel, held))[..., 0])
        told = (unit**2).sum(axis=1)
        usual = float(np.median(told))
        if usual <= 0.0:  # a joint that is held in most segments
            continue
        force = np.zeros((segments.size, segments.intervals, engine.model.nv))
        force[..., dof] = np.sqrt(left / usual)
        moved = _predicted(shooting, fit, force) - before
        does = (beside(start, np.nan_to_num(shooting.noise.whiten(segments, moved))) ** 2).sum(axis=1)
        too_much = np.maximum(too_much, left / usual * told / np.maximum(does, left))
    return np.flatnonzero(too_much <= max(_TIMES, float(np.median(too_much))))


def _predicted(shooting: Shooting, fit: Fit, force: Array | None = None) -> Array:
    """What the sensors would read by a fit with forces on all joints, ``(S, K, nv)``, by what is linearised."""
    candidate = dataclasses.replace(fit.candidate, force=force)
    return shooting.differences.predict(shooting.segments, fit.starts[None], [candidate])[0]
