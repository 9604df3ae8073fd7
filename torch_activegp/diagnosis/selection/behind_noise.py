"""How much names must gain whose rest may be noise that is louder, or of another colour, than was thought."""

from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

BEHIND_COLOUR = 100.0
"""Score, in units of what is left, by which names must be better to be believed that leave coloured noise, or more than
15 % of a mismatch in what may be noise (at 1 to 10 %). In a control at 50 Hz whose filtered noise left 2.3 times its
floor none scored better, and a mass by 53 where a clock jittered; a spring that was missing at 50 Hz scored 336."""
BEHIND_A_FLOOR = 250.0
"""The same behind white noise. In 170 controls names scored better by 42 at most; a gain that was missing on a machine
that strikes scored 563, and left 3 % more than the floor."""
BEHIND_A_FILTER = 1000.0
"""The same in the rows that count of a filtered recording: in a control a backlash gained 176 there, and a centre of
mass 308 in place of an encoder's offset; a spring that was missing on an arm 1920, a damping on a cart 1418, with 9 %
more left than the floor: rows behind a filter are not quite independent."""
_A_LOW_FLOOR = 1.05
"""Times the noise that names leave at most where its floor may be too low."""


def least_gain(shooting: Shooting, best: Fit) -> float:
    """Score by which one or two names must be better that leave what may be noise, though it seems to be none.

    It may be the noise's own colour, where that is seen or would not be, but for videos; or a floor that is a few
    percent too low.

    Args:
        shooting: the likelihood.
        best: the names' fit.

    Returns:
        In units of what is left; infinite where no gain is enough.
    """
    runs = shooting.segments.runs
    if any(run.video for run in runs):
        return np.inf
    if shooting.noise.colour.any() or shooting.hides_colour:
        return BEHIND_COLOUR
    if any(one is not None for run in runs for one in run.filters or ()):
        return BEHIND_A_FILTER
    return BEHIND_A_FLOOR if best.chi2 < _A_LOW_FLOOR * shooting.dof else np.inf
