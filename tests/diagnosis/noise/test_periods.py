from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.noise.floor import noise_floor
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.noise.periods import noise_from_periods, repetition

SIGMA = 1e-3
Make = Callable[..., Run]


def harmonics(rows: int, period: int, seed: int = 0, first: int = 1) -> np.ndarray:
    """A few harmonics of a period, held to the last bit."""
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, (4, 1))
    order = np.arange(first, first + 4)[:, None]
    once = np.sin(2 * np.pi * order * np.arange(period) / period + phase).sum(axis=0)
    return np.tile(once, rows // period + 1)[:rows]


def coloured(poles: tuple[float, float], rows: int, seed: int = 0) -> np.ndarray:
    """Autoregressive noise of standard deviation SIGMA, after it forgot its start."""
    fresh = np.random.default_rng(seed).normal(size=rows + 500)
    out = np.zeros(rows + 500)
    for k in range(2, len(out)):
        out[k] = poles[0] * out[k - 1] + poles[1] * out[k - 2] + fresh[k]
    return SIGMA * NoiseModel(np.ones(1), np.array([poles])).innovation[0] * out[500:]


@pytest.fixture
def make(make_plain_run) -> Make:
    """A run whose controls repeat, with a motion of the same period, noise and whatever is added, at 25 Hz."""

    def run(period: int = 50, periods: int = 12, poles: tuple[float, float] = (0.0, 0.0), **more: object) -> Run:
        rows = period * periods
        seed = int(str(more.get("seed", 0)))
        position = harmonics(rows, period, 7) + coloured(poles, rows, seed) + more.get("add", 0.0)
        step = more.get("step")
        plain = make_plain_run(np.round(position / step) * step if step else position, noise=1e-4)
        control = more.get("control", harmonics(rows, period, 1))
        return dataclasses.replace(plain, time=np.arange(rows) / 25, control=np.asarray(control)[:-1, None])

    return run


@pytest.mark.parametrize("poles", [(0.0, 0.0), (0.7, 0.0), (0.94, 0.0), (1.6, -0.64)])
@pytest.mark.parametrize("period", [20, 50, 173])
def test_level_and_colour_are_found_under_a_motion(make, poles, period) -> None:
    runs = [make(period, 2000 // period, poles, seed=seed) for seed in range(2)]
    found, true = noise_from_periods(runs, 0), NoiseModel(np.array([SIGMA]), np.array([poles]))
    assert found is not None
    level = NoiseModel(np.array([found[1]]), np.array([found[0]]))
    assert level.innovation[0] == pytest.approx(true.innovation[0], rel=0.1)
    assert found[1] == pytest.approx(SIGMA, rel=0.4 if poles[0] == 0.94 else 0.15)


def test_the_floor_is_right_where_the_spectrum_says_nothing(make) -> None:
    """Slow recordings of coloured noise count as white by their differences; fast motion counts as noise."""
    slow, poles = make(poles=(0.88, 0.0)), (0.88, 0.0)
    fast = make(poles=poles, add=harmonics(600, 50, 3, first=18))
    true = NoiseModel(np.array([SIGMA]), np.array([poles])).innovation[0]
    for run in (slow, fast):
        assert noise_floor([run]).innovation[0] == pytest.approx(true, rel=0.15)
        other = dataclasses.replace(run, control=np.cumsum(run.control, axis=0) + np.arange(599.0)[:, None])
        assert not noise_floor([other]).colour.any()


def test_what_has_not_settled_yet_is_left_out(make) -> None:
    decay = 0.5 * np.exp(-np.arange(1200) / 60)
    run = make(periods=24, poles=(0.7, 0.0), add=decay)
    found = noise_from_periods([run], 0)
    assert found is not None
    assert found[1] == pytest.approx(SIGMA, rel=0.2)


@pytest.mark.parametrize(
    "why",
    [
        "it still settles",
        "it drifts",
        "it does not repeat",
        "it is quantised coarsely",
        "no filter makes such a colour",
        "there is hardly any noise",
        "there is too little of it",
        "it alternates",
        "it alternates a little",
        "the clock is uneven",
    ],
)
def test_in_doubt_there_is_no_answer_and_the_floor_is_what_it_was(make, why) -> None:
    k, rng = np.arange(600), np.random.default_rng(5)
    hum = 20 * SIGMA * np.cos(2 * np.pi * 0.21 * k + np.cumsum(0.1 * rng.normal(size=600)))
    once = rng.normal(size=50)
    other = np.tile([*once, *-once], 6)
    run = {
        "it still settles": lambda: make(add=np.exp(-k / 400)),
        "it drifts": lambda: make(add=1e-3 * k),
        "it does not repeat": lambda: make(add=np.cumsum(np.cumsum(0.01 * rng.normal(size=600))) / 10),
        "it is quantised coarsely": lambda: make(step=5 * SIGMA),
        "no filter makes such a colour": lambda: make(add=hum),
        "there is hardly any noise": lambda: make(add=-coloured((0.0, 0.0), 600) * (1 - 1e-3)),
        "there is too little of it": lambda: make(periods=4, period=30),
        "it alternates": lambda: make(add=5.0 * SIGMA * other),
        "it alternates a little": lambda: make(add=0.6 * SIGMA * other),
        "the clock is uneven": lambda: uneven(make, 0.005),
    }[why]()
    assert repetition(run) is not None
    assert noise_from_periods([run], 0) is None
    wobbling = dataclasses.replace(run, control=run.control + 0.01 * rng.normal(size=run.control.shape))
    assert noise_floor([run]).scale == noise_floor([wobbling]).scale


def uneven(make: Make, part: float) -> Run:
    """A run whose rows are that part of a time step early or late, on a motion that goes on evenly."""
    late = part * np.random.default_rng(3).uniform(-1.0, 1.0, 600)
    exact = harmonics(600, 50, 7)
    run = make(add=late * np.gradient(exact))
    return dataclasses.replace(run, time=run.time + late / 25, velocity=25 * np.gradient(exact)[:, None])


def test_a_clock_that_is_even_enough_for_the_speed_will_do(make) -> None:
    found = noise_from_periods([uneven(make, 1e-4)], 0)
    assert found is not None
    assert found[1] == pytest.approx(SIGMA, rel=0.1)


def test_one_run_that_repeats_is_enough_and_the_others_are_not_asked(make) -> None:
    run = make(poles=(0.7, 0.0))
    other = make(control=np.random.default_rng(0).normal(size=600), add=5.0 * np.arange(600))
    assert noise_from_periods([other, run], 0) == noise_from_periods([run], 0)


def test_the_shortest_period_and_where_it_begins(make) -> None:
    control = harmonics(600, 50, 1)
    assert repetition(make(control=control)) == (0, 50)
    assert repetition(make(control=np.where(np.arange(600) < 130, 0.3, control))) == (130, 50)
    assert repetition(make(control=control + 1e-13 * np.random.default_rng(0).normal(size=600))) == (0, 50)


def test_a_standstill_is_no_period_and_may_be_a_part_of_one(make) -> None:
    square = np.where(np.arange(600) % 60 < 30, 1.0, -1.0)
    assert repetition(make(control=square)) == (0, 60)
    assert repetition(make(control=np.where(np.arange(600) < 200, square, 0.0))) is None


def test_two_inputs_repeat_when_both_do(make) -> None:
    run = make()
    both = np.stack([harmonics(599, 30, 1), harmonics(599, 45, 2)], axis=1)
    assert repetition(dataclasses.replace(run, control=both)) == (0, 90)
    idle = np.stack([harmonics(599, 30, 1), np.zeros(599)], axis=1)
    assert repetition(dataclasses.replace(run, control=idle)) == (0, 30)
    pushed = dataclasses.replace(run, force=np.arange(599.0)[:, None])
    assert repetition(pushed) is None


def test_a_control_that_is_recorded_in_fine_steps_repeats_to_within_one(make) -> None:
    rng, smooth = np.random.default_rng(0), harmonics(600, 50, 1)
    for step, period in ((0.005, 50), (1.0, None)):
        read = np.round((smooth + 0.2 * step * rng.normal(size=600)) / step) * step
        found = repetition(make(control=read))
        assert (found and found[1]) == period


@pytest.mark.parametrize(
    "spoil",
    [
        lambda run: dataclasses.replace(run, control=np.zeros_like(run.control)),
        lambda run: dataclasses.replace(run, recorded=np.arange(len(run)) != 300),
        lambda run: dataclasses.replace(run, time=run.time + 0.01 * (np.arange(len(run)) % 2)),
        lambda run: dataclasses.replace(run, control=run.control[::-1] * np.linspace(1, 2, len(run.control))[:, None]),
    ],
)
def test_what_does_not_repeat_has_no_period(make, spoil) -> None:
    assert repetition(spoil(make())) is None
    assert repetition(make(periods=2)) is None
    assert repetition(make(period=10, periods=60))[1] == 20
