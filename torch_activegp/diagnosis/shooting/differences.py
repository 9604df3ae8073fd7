"""Derivatives of residuals by initial states and parameters, by finite differences."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Self

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.fit import difference_steps, split
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.effect import Effect


@dataclasses.dataclass(frozen=True)
class Differences:
    """What is moved, and by how much.

    Args:
        states: steps of the initial states, ``(n,)``; none where the derivatives by them are known.
        places: which parameters are moved, by their places in the row of all.
        steps: by how much, one for each.
    """

    states: Array
    places: Sequence[int] = ()
    steps: Array = dataclasses.field(default_factory=lambda: np.zeros(0))

    @classmethod
    def of(cls, effects: Sequence[Effect], flat: Array, states: Array, known: Mapping[int, Array] | None) -> Self:
        """Moves of states, and of those parameters whose derivatives are not known; of none where that is None."""
        places = [] if known is None else [i for i in range(len(flat)) if i not in known]
        return cls(states, places, difference_steps(effects, flat)[places])

    def candidates(self, effects: tuple[Effect, ...], flat: Array, starts: Array) -> tuple[list[Candidate], Array]:
        """The point itself, then with each state moved, then with each parameter.

        Args:
            effects: a set.
            flat: its parameters in a row, ``(P,)``.
            starts: initial states, ``(S, n)``.

        Returns:
            N candidates, and their initial states, ``(N, S, n)``.
        """
        n = len(self.states)
        begin = np.repeat(starts[None], 1 + n + len(self.places), axis=0)
        if n:
            begin[1 : 1 + n] += np.diag(self.states)[:, None, :]
        out = [Candidate(effects, split(effects, flat))] * (1 + n)
        for place, step in zip(self.places, self.steps, strict=True):
            moved = flat.copy()
            moved[place] += step
            out.append(Candidate(effects, split(effects, moved)))
        return out, begin

    def by_states(self, white: Array) -> Array:
        """Derivatives by the states ``(S, M, n)`` from the whitened residuals of all candidates, ``(N, S, M)``."""
        return _slopes(white[1 : 1 + len(self.states)], white[0], self.states)

    def by_parameters(self, white: Array, known: Mapping[int, Array]) -> Array:
        """The same by all parameters, ``(S, M, P)``; some are known, by their places."""
        fresh = _slopes(white[1 + len(self.states) :], white[0], self.steps)
        columns = dict(known) | {place: fresh[..., k] for k, place in enumerate(self.places)}
        return np.stack([columns[i] for i in range(len(columns))], axis=-1) if columns else fresh


def _slopes(moved: Array, at: Array, steps: Array) -> Array:
    return np.asarray(np.nan_to_num((at - moved) / steps[:, None, None]).transpose(1, 2, 0))
