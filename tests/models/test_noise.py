"""Noise schedules against their formulas."""

from __future__ import annotations

import math
import pickle
from itertools import pairwise

import pytest

from torch_activegp.errors import ConfigurationError
from torch_activegp.models import Count, FixedNoise, HeldNoise, InverseSquareNoise, LearnedNoise, TheoremNoise


def walk(episodes: int, length: int) -> list[Count]:
    """All counts of a run in which every point belongs to an episode of the same length."""
    return [Count((tau - 1) * length + n, tau, n) for tau in range(1, episodes + 1) for n in range(length + 1)]


@pytest.mark.parametrize(("points", "expected"), [(0, 1.0), (1, 1.0), (2, 0.25), (300, 1 / 90_000)])
def test_inverse_square(points: int, expected: float) -> None:
    assert InverseSquareNoise().variance(Count(points, 7, 3)) == expected


@pytest.mark.parametrize(
    ("episode", "step", "expected"), [(1, 0, 1.0), (1, 1, 1.0), (1, 10, 0.01), (3, 5, 25.0**-2), (4, 0, 30.0**-2)]
)
def test_the_theorems_schedule_counts_episodes_and_steps(episode: int, step: int, expected: float) -> None:
    assert TheoremNoise(10).variance(Count(999, episode, step)) == pytest.approx(expected, rel=1e-15)


def test_both_agree_in_episodes_of_equal_length() -> None:
    for count in walk(4, 10):
        assert TheoremNoise(10).variance(count) == InverseSquareNoise().variance(count)


def test_only_a_schedule_that_moves_needs_a_new_factor() -> None:
    before, after = Count(4, 1, 4), Count(5, 1, 5)
    for schedule, holds in [
        (FixedNoise(0.1), True),
        (LearnedNoise(), True),
        (InverseSquareNoise(), False),
        (TheoremNoise(10), False),
        (HeldNoise(InverseSquareNoise(), 2.0), True),  # 4 to 7 are one stage
    ]:
        assert schedule.holds(before, after) is holds, schedule
    assert InverseSquareNoise().holds(Count(0, 1, 0), Count(1, 1, 1))  # 1 at both
    assert not HeldNoise(InverseSquareNoise(), 2.0).holds(Count(7, 1, 7), Count(8, 1, 8))


def test_fixed_noise_stays_and_learned_noise_is_left_to_the_likelihood() -> None:
    for count in walk(2, 3):
        assert FixedNoise(0.3).variance(count) == 0.3
        assert LearnedNoise().variance(count) is None
    assert HeldNoise(LearnedNoise()).variance(Count(9, 1, 9)) is None


@pytest.mark.parametrize("growth", [1.05, 1.25, 2.0])
def test_held_noise_moves_only_when_the_data_has_grown(growth: float) -> None:
    held = HeldNoise(InverseSquareNoise(), growth)
    values = [held.variance(Count(n, 1, n)) for n in range(1, 400)]
    stages = [n for n in range(2, 400) if values[n - 1] != values[n - 2]]
    for earlier, later in pairwise(stages):
        assert later == max(earlier + 1, math.floor(earlier * growth))
    for n, value in enumerate(values, start=1):
        stage = max([1, *(stage for stage in stages if stage <= n)])
        assert value == 1 / stage**2
        assert 1 / n**2 <= value <= max(growth**2, 4.0) / n**2  # the price: a factor of the growth squared


def test_held_noise_within_an_episode_of_the_theorems_schedule() -> None:
    held = HeldNoise(TheoremNoise(10), 2.0)
    values = [held.variance(count) for count in walk(3, 10)]
    assert all(later <= earlier for earlier, later in pairwise(values))
    assert held.variance(Count(15, 2, 5)) == 10.0**-2  # stage 8 lies before the episode: held where it began
    assert held.variance(Count(17, 2, 7)) == 16.0**-2
    assert held.variance(Count(0, 1, 0)) == 1.0


@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_fixed_noise_must_be_positive(value: float) -> None:
    with pytest.raises(ConfigurationError, match=f"Wanted a positive noise variance, found {value}"):
        FixedNoise(value)


@pytest.mark.parametrize("growth", [1.0, 0.5, math.inf, math.nan])
def test_growth_must_be_above_one(growth: float) -> None:
    with pytest.raises(ConfigurationError, match=f"Wanted a finite growth > 1, found {growth}"):
        HeldNoise(InverseSquareNoise(), growth)


def test_an_episode_has_a_length() -> None:
    with pytest.raises(ConfigurationError, match="Wanted episode_length >= 1, found 0"):
        TheoremNoise(0)


@pytest.mark.parametrize(
    "schedule",
    [InverseSquareNoise(), TheoremNoise(7), FixedNoise(0.2), LearnedNoise(), HeldNoise(TheoremNoise(7), 1.5)],
    ids=lambda schedule: type(schedule).__name__,
)
def test_schedules_pickle(schedule: FixedNoise) -> None:
    copied = pickle.loads(pickle.dumps(schedule))
    assert [copied.variance(count) for count in walk(3, 7)] == [schedule.variance(count) for count in walk(3, 7)]
