"""Noise schedules: how large the assumed observation noise is after n points.

A schedule gives the *relative* noise variance, in units of the squared output scale of the GP (which is 1 in the
paper). It also decides how the posterior is updated: while the noise is held, a new point is appended to the Cholesky
factor in O(n^2); when it changes, the whole diagonal changes and the factor is recomputed in O(n^3).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import NamedTuple

from torch_activegp.errors import ConfigurationError


class Count(NamedTuple):
    """How much data a GP has seen.

    Attributes:
        points: points in all episodes.
        episode: index tau of the present episode, from 1.
        step: points n of the present episode.
    """

    points: int
    episode: int
    step: int


class NoiseSchedule(ABC):
    """Relative noise variance as a function of the amount of data."""

    @abstractmethod
    def variance(self, count: Count) -> float | None:
        """The relative noise variance, or None to leave the likelihood's own (learned) noise in place."""

    def holds(self, before: Count, after: Count) -> bool:
        """Whether the noise is the same at both counts, so that the new points can be appended."""
        return self.variance(before) == self.variance(after)


class InverseSquareNoise(NoiseSchedule):
    """sigma^2 = 1 / n^2 with n all points so far.

    Example:
        >>> InverseSquareNoise().variance(Count(points=10, episode=1, step=10))
        0.01

    Reference: Miller et al. 2024, section IV (experiments).
    """

    def variance(self, count: Count) -> float:
        """1 / n^2."""
        return 1.0 / max(count.points, 1) ** 2


class TheoremNoise(NoiseSchedule):
    """sigma^2 = ((tau - 1) N + n)^-2, for which the paper bounds the largest variance.

    It differs from :class:`InverseSquareNoise` where episodes have different lengths or where there was data before
    the first episode.

    Args:
        episode_length: steps per episode N.

    Raises:
        ConfigurationError: ``episode_length`` is not positive.

    Reference: Miller et al. 2024, Theorem 1.
    """

    def __init__(self, episode_length: int) -> None:
        if episode_length < 1:
            raise ConfigurationError(f"Wanted episode_length >= 1, found {episode_length}.")
        self.episode_length = episode_length

    def variance(self, count: Count) -> float:
        """((tau - 1) N + n)^-2."""
        return 1.0 / max((count.episode - 1) * self.episode_length + count.step, 1) ** 2


class FixedNoise(NoiseSchedule):
    """The same relative noise variance for ever: every update is an append.

    Args:
        value: relative noise variance.

    Raises:
        ConfigurationError: ``value`` is not positive and finite.
    """

    def __init__(self, value: float) -> None:
        if not (value > 0 and math.isfinite(value)):
            raise ConfigurationError(f"Wanted a positive noise variance, found {value}.")
        self.value = float(value)

    def variance(self, count: Count) -> float:
        """The fixed value."""
        return self.value


class LearnedNoise(NoiseSchedule):
    """The likelihood's own noise, as gpytorch or :func:`~torch_activegp.models.fit_hyperparameters` fitted it."""

    def variance(self, count: Count) -> None:
        """None: the likelihood is left alone."""
        return


class HeldNoise(NoiseSchedule):
    """Another schedule, held in stages: it moves only when the data has grown by ``growth``.

    Most updates are then appends, at the price of a slightly larger noise. A schedule that counts episodes may also
    move when one begins.

    Args:
        schedule: the schedule to hold.
        growth: ratio between the numbers of points at which the noise moves, above 1.

    Raises:
        ConfigurationError: ``growth`` is not above 1 and finite.

    Example:
        >>> HeldNoise(InverseSquareNoise(), growth=2.0).variance(Count(points=15, episode=1, step=15)) == 1 / 8**2
        True
    """

    def __init__(self, schedule: NoiseSchedule, growth: float = 1.25) -> None:
        if not 1 < growth < math.inf:
            raise ConfigurationError(f"Wanted a finite growth > 1, found {growth}.")
        self.schedule = schedule
        self.growth = growth

    def variance(self, count: Count) -> float | None:
        """The other schedule's value at the last stage."""
        stage = 1
        while (following := max(stage + 1, math.floor(stage * self.growth))) <= count.points:
            stage = following
        behind = min(count.step, max(count.points - stage, 0))
        return self.schedule.variance(Count(min(stage, count.points), count.episode, count.step - behind))
