"""Names that leave much are none where the recordings are in doubt, or where no simulator at all would say as much."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.preparation.rivals import beside
from torch_activegp.diagnosis.selection.process_left import by_positions
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

MUCH_LEFT = 100.0
"""Times the noise, in chi2 per degree of freedom, that names may leave where they are doubted: the best ones of a real
pendulum left 20 of a noise of 0.02 mrad, wrong ones beside two controls in another unit 640000."""
DOUBTED_LEFT = 2.0
"""Times the noise from which on names are doubted where a column is. A telescope's drive whose controls were a hundred
times too large was an armature of 137 for 0.35 kg m2, which left 7.7; no other of 600 diagnoses had names beside such a
doubt."""
NO_SKILL = 0.05
"""Part of what straight lines leave from which on such names forecast little. The right ones of two real drives left
0.0005 and 0.0012 of it. A motor that a speed loop turned against its cogging was lost by every simulator within a
hundredth of a second, and a dead zone over all its current left 0.9998; a gain and a sensor that stood for a command in
degrees left 0.18."""


def reservation(shooting: Shooting, fit: Fit, doubts: Sequence[str], undriven: Sequence[str] = ()) -> str | None:
    """What speaks against names that leave much, in words; None where nothing.

    Controls in another unit, a hundred times too large, were a payload of four times the arm and a sensor gain at its
    limit: "explaining 100 %" of a mismatch so large that what was left was 640000 times the noise. And beside a nominal
    that runs away all is explained by what takes its forces away; the skill of a forecast shows beside a trivial one.

    Args:
        shooting: the likelihood.
        fit: the effects that are named.
        doubts: of columns that may be in another unit or of another sign, in sentences.
        undriven: that no control was recorded, in sentences.
    """
    shooting, fit = by_positions(shooting, fit)
    left = fit.chi2 / shooting.dof
    if left < (DOUBTED_LEFT if doubts else MUCH_LEFT):
        return None
    leave = f"leave {left:.3g} times the noise (chi2 per dof)"
    if doubts or undriven:
        return f"{leave}, and {'a column is in doubt' if doubts else 'no control is recorded'}"
    lines = straight_lines(shooting)
    if fit.chi2 > NO_SKILL * lines:
        pieces = f"each {shooting.segments.usual_seconds:.2g} s of the recordings"
        return f"{leave}, {fit.chi2 / lines:.2g} of what straight lines through {pieces} do"
    return None


def straight_lines(shooting: Shooting) -> float:
    """Chi2 that each joint at a constant speed leaves, another one in each segment: a forecast without a simulator.

    It has as many free numbers as the initial states of a simulation.

    Args:
        shooting: the likelihood.
    """
    segments = shooting.segments
    position = segments.position
    time = np.cumsum(np.pad(segments.dt, ((0, 0), (1, 0))), axis=1)
    joints = np.eye(position.shape[-1])
    columns = np.concatenate([np.multiply.outer(time**power, joints) for power in (0, 1)], axis=-1)
    left = beside(shooting.whiten_columns(columns), shooting.noise.whiten(segments, position))
    return float((left**2).sum())
