"""A mismatch in one place: what acts only somewhere, and was hardly met, is little of all that was recorded."""

from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.touching import touching, widened

_FAR = 5.0
"""Times the noise, and what the median segment leaves, that one stands out by: 2.5 at most on 110 machines on which
noise alone was left. A pocket of negative damping that was met once left 16 in one segment, and 1.25 in all."""


def stands_out(shooting: Shooting, fit: Fit, louder: float) -> bool:
    """Whether a fit leaves far more in some segment than in most, and nothing is about to touch there.

    Where something is, an instant of contact that is a little off leaves as much.

    Args:
        shooting: the likelihood.
        fit: of any set.
        louder: by how much noise may be louder than its floor, in chi2 per degree of freedom.
    """
    segments, channels = shooting.segments, shooting.engine.channels
    each, wide = fit.per_segment / segments.samples, widened(shooting.engine.model)
    for number in np.flatnonzero(each > _FAR * (1.0 + louder) * max(float(np.median(each)), 1.0)):
        rows = np.arange(segments.first[number], segments.scored[number, 1] + 1)
        if not touching(wide, channels, segments.runs[segments.run[number]], rows).any():
            return True
    return False
