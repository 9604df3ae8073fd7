"""Is anything left that a force free in time would explain?"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import stats

from torch_activegp.diagnosis.selection.free_force import free_force_columns
from torch_activegp.diagnosis.shooting.elimination import eliminate, scaled
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting


@dataclasses.dataclass(frozen=True)
class Omnibus:
    """Is anything left that a force free in time would explain?

    Args:
        excess: decrease of chi2 beyond what noise gives, never negative.
        p_value: of the F test.
    """

    excess: float
    p_value: float


def omnibus(shooting: Shooting, fit: Fit) -> Omnibus:
    """F test of a free force in bins of 0.2 s against none, on top of a fit."""
    residual, states, forces = free_force_columns(shooting, fit, seconds=0.2)
    clean = np.nan_to_num(shooting.noise.whiten(shooting.segments, residual))
    linear = eliminate(shooting.whiten_columns(states), shooting.whiten_columns(forces), clean)
    gain, count = 0.0, 0
    for normal, gradient in zip(linear.normal, linear.gradient, strict=True):
        matrix, scale = scaled(normal)
        value, vector = np.linalg.eigh(matrix)
        seen = value > 1e-8
        gain += float((((vector.T @ (gradient / scale)) ** 2)[seen] / value[seen]).sum())
        count += int(seen.sum())
    left = float((clean**2).sum()) - float((np.einsum("smn,sm->sn", linear.basis, clean) ** 2).sum()) - gain
    dof = max(shooting.dof - count, 1)
    ratio = (gain / max(count, 1)) / max(left / dof, 1e-300)
    return Omnibus(max(gain - count * left / dof, 0.0), float(stats.f.sf(ratio, max(count, 1), dof)))
