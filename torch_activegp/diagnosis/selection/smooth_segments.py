"""Segments of a machine that touches something in which its linearisation says something."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.preparation.rivals import beside
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import Linearization
from torch_activegp.diagnosis.simulation.touching import strikes

_OFF = 0.5
"""Part of what a push does that its linearisation may be off, as sums of squares: one was 1e5 times that off, and 2,
and the others of the same twelve segments mostly below 0.01."""
_LEAST = 10.0
"""Chi2 that a push makes at least, in the median."""


def smooth_segments(shooting: Shooting, fit: Fit, linear: Linearization) -> NDArray[np.int64]:
    """Those in which constant forces do about what the linearisation foresees; all where nothing touches.

    And where it foresees little in more than half of them. At an impact finite differences are of any size, and one
    such segment outweighs all others in normal equations: on a leg that stands and hops one of twelve held 30 thousand
    times the information on a payload that the others did. These agreed on 0.22 kg that gained 13500; together they saw
    0.0003 kg and a gain of 111, and four other names came first.

    Args:
        shooting: the likelihood.
        fit: to its S segments.
        linear: the machine's linearisation around the fit.
    """
    engine, segments = shooting.engine, shooting.segments
    smooth = np.ones(segments.size, dtype=bool)
    if strikes(engine.model, engine.channels, segments.runs):
        start, before = shooting.whiten_columns(linear.respond_to_start()), shooting.predicted(fit)
        held = np.ones((segments.size, segments.intervals, 1))
        left = max(float(np.median(fit.per_segment - segments.samples)), _LEAST)
        for channel, dof in enumerate(engine.channels.dof):
            unit = shooting.whiten_columns(linear.respond_to_force(channel, held))[..., 0]
            unit = beside(start, unit)
            strength = np.sqrt(left / max(float(np.median((unit**2).sum(axis=1))), 1e-300))
            force = np.zeros((segments.size, segments.intervals, engine.model.nv))
            force[..., dof] = strength
            pushed = dataclasses.replace(fit.candidate, force=force)
            moved = engine.predict(segments, fit.starts[None], [pushed])[0] - before
            moved = beside(start, np.nan_to_num(shooting.noise.whiten(segments, moved)))
            off = ((moved - strength * unit) ** 2).sum(axis=1)
            smooth &= off <= _OFF * (moved**2).sum(axis=1)
    return np.flatnonzero(smooth) if 2 * smooth.sum() >= segments.size else np.arange(segments.size)
