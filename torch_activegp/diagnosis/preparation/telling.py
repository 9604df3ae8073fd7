"""How much of the data tells enough to choose a form of the model by, and to compare sets with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine

_JUDGES = 16
_PART = 0.25
"""Forms are compared on this part of the segments; on fewer, but so many, where they take long (see below)."""
_AFFORDED, _PLENTY = 25e3, 30e3
"""Where simulating all segments once takes more time steps than this, as many are taken as take so many and leave so
much chi2 above the noise, of which 0.1 % is 30. A valve of dry friction recorded to 0.05 mrad took 280 thousand."""
CREEPS = 12
"""Rounds for the nominal's fit behind a set: one that is far off creeps, and what is near is fitted once more later."""


def enough(engine: Engine, segments: Segments) -> float:
    """The share of some segments on which forms are compared, of which one takes the longest."""
    return max(_JUDGES / segments.size, min(_PART, _affordable(engine, segments)))


def _affordable(engine: Engine, segments: Segments) -> float:
    """The share of some segments that an engine simulates in time, at least two of each run."""
    return max(_AFFORDED / engine.steps_in(segments), max(_JUDGES, 2 * len(segments.runs)) / segments.size)


def telling(whole: Shooting, working: Shooting, nominal: Fit, here: Fit) -> NDArray[np.int64]:
    """Segments, evenly spread, that tell enough where simulating all takes long; else all.

    Args:
        whole: the likelihood over all segments.
        working: that over some, by the form to simulate with.
        nominal: a fit of the nominal to all, by any form.
        here: the same fit over those of `working`.
    """
    segments = whole.segments
    share = _affordable(working.engine, segments)
    if share >= 1.0:
        return np.arange(segments.size)
    bare = working.fit([((), ())], here.starts, CREEPS, near=here)[0]  # discretisation alone tells nothing
    excess = (min(bare.chi2, nominal.chi2 * working.dof / whole.dof) - working.dof) * whole.dof / working.dof
    return whole.subset(max(share, _PLENTY / max(excess, 1.0)))[1]
