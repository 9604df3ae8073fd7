"""What is left because recorded times were rounded, where rows are uneven: neither physics nor an encoder's noise."""

from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.inputs.rounded_times import rounding
from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.preparation.rivals import beside
from torch_activegp.diagnosis.selection.judge import VISIBLE_SOMEWHERE
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_TOGETHER = 16
"""Segments whose derivatives by all of their rows' times are kept at once."""
_BY_CHANCE = 3.0
"""Standard deviations of the chi2 of noise alone in a segment that are none of its mismatch."""


def left_beside_rounding(shooting: Shooting, nominal: Fit) -> Array:
    """Chi2 that is left in each segment, ``(S,)``, where the recorded times may be off by what they were rounded to.

    The time of each row is off by noise of its own, which moves the row and, for a control acts for as long as the
    clock says, all later ones: on a slide at 100 Hz under a chirp, times to 0.1 ms left 32 times the noise of 0.06 mm
    in one of 53 segments, and 2.05 in all, of a simulator without any fault. It is noise beside that of the encoders,
    to first order and behind initial states (Woodbury's identity).

    Args:
        shooting: the likelihood.
        nominal: its fit.

    Returns:
        That of the fit where no run was rounded.
    """
    segments = shooting.segments
    steps = np.array([rounding(run) for run in segments.runs])[segments.run]
    if not steps.any():
        return nominal.per_segment
    if nominal.design is None:
        nominal = shooting.fit([((), ())], nominal.starts, rounds=1, hold=True)[0]
    parts = np.array_split(np.arange(segments.size), -(-segments.size // _TOGETHER))
    absorbed = [_absorbed(shooting.pick(part), nominal.pick(part), steps[part]) for part in parts]
    return np.asarray(nominal.per_segment - np.concatenate(absorbed))


def _absorbed(shooting: Shooting, nominal: Fit, steps: Array) -> Array:
    """Chi2 that times which were rounded to some steps ``(S,)`` take off each segment, ``(S,)``."""
    assert nominal.design is not None
    segments, before, columns = shooting.segments, shooting.predicted(nominal), []
    for row in range(segments.intervals + 1):
        dt = segments.dt.copy()  # of which half a step is a small part
        dt[:, max(row - 1, 0) : row] += 0.5 * steps[:, None]
        dt[:, row : row + 1] -= 0.5 * steps[:, None]
        moved = dataclasses.replace(shooting, segments=dataclasses.replace(segments, dt=dt)).predicted(nominal) - before
        columns.append(beside(nominal.design, np.nan_to_num(shooting.noise.whiten(segments, moved))))
    moves = np.stack(columns, axis=-1) * (2.0 / np.sqrt(12.0))  # of the standard deviation of what is rounded
    along = np.einsum("smk,sm->sk", moves, beside(nominal.design, shooting.residual_of(nominal)))
    inner = np.eye(moves.shape[-1]) + np.einsum("smk,sml->skl", moves, moves)
    return np.asarray((along * np.linalg.solve(inner, along[..., None])[..., 0]).sum(axis=1))


def rounded_clock(shooting: Shooting, nominal: Fit) -> str:
    """That the rounded clock may have left all that is more than noise, in a sentence; empty where it did not.

    All but for a tenth of the noise, also of that in single segments.

    Args:
        shooting: the likelihood.
        nominal: its fit.
    """
    left = left_beside_rounding(shooting, nominal)
    if left is nominal.per_segment:
        return ""
    noise = shooting.segments.samples * (shooting.dof / shooting.samples)
    high = np.maximum(left - noise - _BY_CHANCE * np.sqrt(2.0 * noise), 0.0).sum()
    if max(high, left.sum() - shooting.dof) > VISIBLE_SOMEWHERE * shooting.dof:
        return ""
    step = max(rounding(run) for run in shooting.segments.runs)
    return (
        f"Recorded times are multiples of {step:.2g} s at uneven rows. Rounding them so may leave the "
        f"{nominal.chi2 / shooting.dof:.3g} times the noise (chi2 per dof) that are seen: beside it "
        f"{left.sum() / shooting.dof:.3g} times are left. Times with more digits would tell more."
    )
