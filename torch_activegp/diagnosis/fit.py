"""A set of effects fitted to segments."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.engine import Candidate
from torch_activegp.diagnosis.runs import Array
from torch_activegp.physics.effect import Effect


@dataclasses.dataclass(frozen=True)
class Fit:
    """A set of effects fitted to segments.

    Args:
        effects: the set.
        values: the parameters of each.
        starts: initial states, ``(S, nq + nv)``.
        chi2: sum of squares of the whitened residuals.
        per_segment: its parts, ``(S,)``.
        information: normal matrix of the parameters after the states are eliminated, ``(P, P)``.
        scores: gradient of half the chi2 in each segment, ``(S, P)``.
        design: derivatives of the whitened residuals by the initial states, ``(S, M, nq + nv)``.
    """

    effects: tuple[Effect, ...]
    values: tuple[Array, ...]
    starts: Array
    chi2: float
    per_segment: Array
    information: Array
    scores: Array
    design: Array | None = None

    @property
    def candidate(self) -> Candidate:
        """What to simulate."""
        return Candidate(self.effects, self.values)

    @property
    def size(self) -> int:
        """Number of parameters P."""
        return sum(len(v) for v in self.values)

    @property
    def plausible(self) -> bool:
        """Whether a machine can have all the effects with these values."""
        return all(effect.plausible(values) for effect, values in zip(self.effects, self.values, strict=True))

    @property
    def keys(self) -> frozenset[tuple[str, str]]:
        """Names and targets."""
        return frozenset(effect.key for effect in self.effects)

    def pick(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> Fit:
        """What it is on some of the segments."""
        per_segment = self.per_segment[which]
        return dataclasses.replace(
            self,
            starts=self.starts[which],
            chi2=float(per_segment.sum()),
            per_segment=per_segment,
            scores=self.scores[which],
            design=None if self.design is None else self.design[which],
        )

    def steps(self) -> Array:
        """Scales of the parameters, ``(P,)``."""
        return np.array([p.scale for effect in self.effects for p in effect.parameters])
