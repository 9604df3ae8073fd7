"""Where a fit is on its way, and what it needs of the likelihood."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments

FAILED = 1e30
"""Stands for the chi2 of a segment whose simulation failed."""


class Likelihood(Protocol):
    """What a problem needs of the likelihood."""

    @property
    def segments(self) -> Segments:
        """The segments."""
        ...

    @property
    def lends(self) -> bool:
        """Whether derivatives come from another simulation than the residuals."""
        ...

    def state_columns(self, starts: Array) -> Array:
        """Perturbations of the initial states worth trying, ``(n,)``."""
        ...

    def state_reach(self) -> Array:
        """How far an initial state may sensibly move in one step, ``(n,)``."""
        ...


class Point(NamedTuple):
    """Parameters and initial states, and how well they fit.

    Args:
        flat: the parameters in a row, ``(P,)``.
        starts: initial states, ``(S, nq + nv)``.
        per_segment: chi2 of every segment, ``(S,)``.
    """

    flat: Array
    starts: Array
    per_segment: Array

    @property
    def chi2(self) -> float:
        """That of all segments, :func:`total`."""
        return total(self.per_segment)


def chi2_of(white: Array, failed: float = FAILED) -> Array:
    """The chi2 of segments ``(...)`` from their whitened residuals ``(..., M)``; `failed` where a simulation failed."""
    return np.asarray(np.nan_to_num((white**2).sum(-1), nan=failed, posinf=failed))


def total(per_segment: Array) -> float:
    """The chi2 of all segments, infinite where a simulation failed."""
    chi2 = float(per_segment.sum())
    return chi2 if chi2 < FAILED else np.inf
