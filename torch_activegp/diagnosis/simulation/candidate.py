"""A model to simulate: the nominal one with effects."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.physics.effect import Effect


@dataclasses.dataclass(frozen=True)
class Candidate:
    """The nominal model with effects.

    Args:
        effects: which.
        values: the parameters of each, ``(P,)``.
        force: a further generalised force in every interval of every segment, ``(S, K, nv)``, N m or N, or None.
        shove: a further control, ``(S, K, nu)``, or None.
    """

    effects: tuple[Effect, ...] = ()
    values: tuple[Array, ...] = ()
    force: Array | None = None
    shove: Array | None = None

    def pick(self, which: NDArray[np.bool_] | NDArray[np.int64], intervals: int | None = None) -> Candidate:
        """The same in some of the segments, and in their first intervals, all unless said."""
        if self.force is None and self.shove is None:
            return self
        force, shove = (None if more is None else more[which, :intervals] for more in (self.force, self.shove))
        return dataclasses.replace(self, force=force, shove=shove)

    def anew(self) -> Candidate:
        """The same for one step from a state alone, :meth:`Effect.anew`."""
        return dataclasses.replace(self, effects=tuple(effect.anew() for effect in self.effects))


NOMINAL = Candidate()


def grouped(candidates: Sequence[Candidate]) -> Iterator[tuple[Effect, NDArray[np.int64], Array]]:
    """Each effect once, with the n candidates that have it ``(n,)`` and their values ``(n, P)``."""
    members: dict[Effect, list[tuple[int, Array]]] = {}
    for i, candidate in enumerate(candidates):
        for effect, values in zip(candidate.effects, candidate.values, strict=True):
            members.setdefault(effect, []).append((i, values))
    for effect, pairs in members.items():
        yield effect, np.array([i for i, _ in pairs]), np.stack([v for _, v in pairs])
