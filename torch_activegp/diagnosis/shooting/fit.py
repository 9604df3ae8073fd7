"""A set of effects fitted to segments."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.point import total
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.effect import Effect

_ABOUT, _SHAPED = 0.1, 0.01
"""Parts by which an amplitude, and a parameter that shapes a law, may differ from where a derivative was taken: six
sets, each with those of the one before, ended within 0.01 of the chi2 that they reach with their own."""


@dataclasses.dataclass(frozen=True, eq=False)
class Fit:
    """A set of effects fitted to segments.

    Args:
        effects: the set.
        values: the parameters of each.
        starts: initial states, ``(S, nq + nv)``.
        chi2: sum of squares of the whitened residuals.
        per_segment: its parts, ``(S,)``.
        information: normal matrix of the parameters after the states are eliminated, ``(P, P)``; empty where the
            parameters were held, and zero where it ended before they moved.
        scores: gradient of half the chi2 in each segment, ``(S, P)``; as empty there.
        design: derivatives of the whitened residuals by the initial states, ``(S, M, nq + nv)``.
        columns: the same by the parameters, ``(S, M, P)``.
        taken: the parameters with which these were taken, ``(P,)``.
        at_rest: whether it was given up where it does no more than a smaller set (:func:`resting`): its information and
            scores are zero, and nothing is known of it.
    """

    effects: tuple[Effect, ...]
    values: tuple[Array, ...]
    starts: Array
    chi2: float
    per_segment: Array
    information: Array
    scores: Array
    design: Array | None = None
    columns: Array | None = None
    taken: Array | None = None
    at_rest: bool = False

    @property
    def candidate(self) -> Candidate:
        """What to simulate."""
        return Candidate(self.effects, self.values)

    @property
    def by_effect(self) -> dict[Effect, Array]:
        """The parameters of each effect."""
        return dict(zip(self.effects, self.values, strict=True))

    def part(self, effects: Iterable[Effect]) -> tuple[tuple[Effect, ...], tuple[Array, ...]]:
        """Some of its effects, with their parameters."""
        kept, known = tuple(effects), self.by_effect
        return kept, tuple(known[effect] for effect in kept)

    @property
    def size(self) -> int:
        """Number of parameters P."""
        return sum(len(v) for v in self.values)

    @property
    def places(self) -> dict[Effect, slice]:
        """Where the parameters of each effect are in the row of all."""
        ends = np.cumsum([len(v) for v in self.values]).tolist()
        return {e: slice(end - len(v), end) for e, v, end in zip(self.effects, self.values, ends, strict=True)}

    @property
    def is_known(self) -> bool:
        """Whether it says how certain its parameters are: they were not held, nor was it given up at rest."""
        return not self.at_rest and len(self.information) == self.size

    @property
    def plausible(self) -> bool:
        """Whether a machine can have all the effects with these values."""
        return plausible(self.effects, self.values)

    @property
    def keys(self) -> frozenset[tuple[str, str]]:
        """Names and targets."""
        return frozenset(effect.key for effect in self.effects)

    @property
    def without_derivatives(self) -> Fit:
        """The same, and lighter."""
        if self.design is None and self.columns is None:
            return self
        return dataclasses.replace(self, design=None, columns=None, taken=None)

    def columns_of(self, effects: Sequence[Effect], values: Sequence[Array]) -> dict[int, Array]:
        """Derivatives by those parameters of a set that have about these values here too.

        Returns:
            By the parameter's place in the row of all, ``(S, M)`` each.
        """
        out: dict[int, Array] = {}
        if self.columns is None or self.taken is None:
            return out
        by_parameter = split(self.effects, np.moveaxis(self.columns, -1, 0))
        there = dict(zip(self.effects, zip(split(self.effects, self.taken), by_parameter, strict=True), strict=True))
        place = 0
        for effect, value in zip(effects, values, strict=True):
            if effect in there:
                own, columns = there[effect]
                part = np.where(np.arange(len(value)) < effect.linear, _ABOUT, _SHAPED)
                if (np.abs(value - own) <= part * np.abs(own)).all():
                    out |= {place + i: column for i, column in enumerate(columns)}
            place += len(value)
        return out

    def beginning(self, which: NDArray[np.int64], states: Array) -> Fit:
        """The same with other initial states ``(n, nq + nv)`` in some segments, ``(n,)``."""
        starts = self.starts.copy()
        starts[which] = states
        return dataclasses.replace(self, starts=starts)

    def pick(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> Fit:
        """What it is on some of the segments; its information is still that of all."""
        per_segment = self.per_segment[which]
        return dataclasses.replace(
            self,
            starts=self.starts[which],
            chi2=total(per_segment),
            per_segment=per_segment,
            scores=self.scores[which],
            design=None if self.design is None else self.design[which],
            columns=None if self.columns is None else self.columns[which],
        )


def inside(effects: Sequence[Effect], values: Sequence[Array], below: Fit | None) -> tuple[Fit, Array] | None:
    """A set as a fit and further effects that do nothing.

    Returns:
        The fit, and parameters in a row ``(P,)``; None where the set does not hold the fit's effects, or others beside
        them than linear and tunable ones, which do nothing at zero.
    """
    if below is None or not set(below.effects) < set(effects):
        return None
    known = below.by_effect
    if not all(effect in known or effect.linear or effect.tunable for effect in effects):
        return None
    flat = [known.get(effect, effect.absent(value)) for effect, value in zip(effects, values, strict=True)]
    return below, np.concatenate(flat)


def resting(effects: Sequence[Effect], flat: Array, below: Fit) -> Fit:
    """A set at parameters in a row ``(P,)`` that do no more than a smaller set, as :func:`inside` has them."""
    unknown = np.zeros((len(flat), len(flat))), np.zeros((len(below.starts), len(flat)))
    values = split(effects, flat)
    there = below.starts, below.chi2, below.per_segment
    return Fit(tuple(effects), values, *there, *unknown, below.design, at_rest=True)


def plausible(effects: Sequence[Effect], values: Sequence[Array]) -> bool:
    """Whether a machine can have all of some effects with these values."""
    return all(effect.plausible(value) for effect, value in zip(effects, values, strict=True))


def split(effects: Sequence[Effect], flat: Array) -> tuple[Array, ...]:
    """The parameters of each effect, from those of all in a row ``(P,)``."""
    edges = np.cumsum([len(effect.parameters) for effect in effects])[:-1]
    return tuple(np.split(flat, edges)) if len(effects) else ()


def bounds(effects: Sequence[Effect]) -> tuple[Array, Array]:
    """Least and largest values of the parameters of some effects, all in a row, ``(P,)`` each."""
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    return np.array([p.low for p in parameters], dtype=float), np.array([p.high for p in parameters], dtype=float)


def difference_steps(effects: Sequence[Effect], flat: Array) -> Array:
    """Small changes of the parameters of some effects, all in a row, for finite differences, ``(P,)``."""
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    return np.array([p.step(value) for p, value in zip(parameters, flat, strict=True)], dtype=float)
