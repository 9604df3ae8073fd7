"""A mismatch in one place: what acts only somewhere, and was hardly met, is little of all that was recorded."""

from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.touching import touching

_FAR = 5.0
"""Times the noise, and what the median segment leaves, that one stands out by: 2.5 at most on 110 machines on which
noise alone was left. A pocket of negative damping that was met once left 16 in one segment, and 1.25 in all."""


def stands_out(shooting: Shooting, fit: Fit) -> bool:
    """Whether a fit leaves far more in some segment than in most, and nothing touches there.

    Where something does, an instant of contact that is a little off leaves as much.
    """
    segments, engine = shooting.segments, shooting.engine
    each = fit.per_segment / segments.samples
    for number in np.flatnonzero(each > _FAR * max(float(np.median(each)), 1.0)):
        rows = np.arange(segments.first[number], segments.scored[number, 1] + 1)
        if not touching(engine.model, engine.channels, segments.runs[segments.run[number]], rows).any():
            return True
    return False
