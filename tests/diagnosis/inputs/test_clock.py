"""Recorded times that scatter, of machines that were sampled evenly, unevenly, or in between."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.clock import Clock, truer_times
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.runs import Channels

STEP, NOISE = 0.01, 3e-4
MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body><joint name="hip" axis="0 1 0"/><geom size=".1"/>
    <body pos="0 0 .3"><joint name="slide" type="slide"/><geom size=".1"/></body></body></worldbody></mujoco>"""
)


def recorded(
    unevenly: float = 0.0,
    stamped: float = 0.0,
    seed: int = 0,
    rows: int = 600,
    lost: float = 0.0,
    speed: float = 3.0,
    wander: float = 0.0,
    turns: bool = False,
) -> tuple[Recording, np.ndarray]:
    """A run whose rows were taken off an even clock by so much, s, and stamped off that; and when they were taken."""
    rng = np.random.default_rng(seed)
    taken = STEP * np.arange(rows) + wander * np.sin(np.arange(rows) / 50.0) + unevenly * rng.normal(size=rows)
    stamps = taken + stamped * rng.normal(size=rows)
    hip = speed * (taken + 0.1 * np.sin(7.0 * taken)) if turns else speed * np.sin(3.0 * taken)
    noise = NOISE * rng.normal(size=(2, rows))
    columns = {"qpos.hip": hip + noise[0], "qpos.slide": 0.2 * speed * np.cos(5.0 * taken) + noise[1]}
    if turns:
        columns["qpos.hip"] = np.angle(np.exp(1j * columns["qpos.hip"]))
    kept = np.ones(rows, dtype=bool)
    kept[1:-1] = rng.random(rows - 2) >= lost
    table = {"time": stamps, **columns}
    return Recording.from_columns(f"run{seed}", {name: values[kept] for name, values in table.items()}), taken[kept]


def read(*recordings: Recording) -> tuple[list[Recording], str]:
    return truer_times(recordings, Channels.of(MODEL, recordings))


def apart(recording: Recording, taken: np.ndarray) -> float:
    """By how much times are off those at which the rows were taken, but for one offset, rms, s."""
    return float(np.std(recording.time.numpy() - taken))


@pytest.mark.parametrize("options", [{}, {"lost": 0.2, "speed": 1.0, "rows": 2000}, {"turns": True}])
def test_stamps_of_an_even_clock_that_scatter_are_made_even(options: dict) -> None:
    run, taken = recorded(stamped=4e-4, **options)
    (moved,), said = read(run)
    assert apart(run, taken) > 3.5e-4
    assert apart(moved, taken) < 4e-5
    assert re.search(r"scatter by 0\.(38|39|4|41|42) ms", said)
    assert "they are taken to be even" in said
    assert moved["qpos.hip"].equal(run["qpos.hip"])


def test_what_leaps_does_not_hide_the_clock() -> None:
    run, taken = recorded(stamped=4e-4)
    hip = run["qpos.hip"].clone()
    hip[100::100] += 0.3
    (moved,), _ = read(run.replace({"qpos.hip": hip}))
    assert apart(moved, taken) < 4e-5


@pytest.mark.parametrize("options", [{}, {"lost": 0.04, "speed": 9.0}, {"turns": True}, {"unevenly": 2e-3}, {"wander": 5e-3}])
def test_times_of_rows_that_were_taken_unevenly_stay(options: dict) -> None:
    run, _ = recorded(**{"unevenly": 5e-4, **options})
    (same,), said = read(run)
    assert same is run
    assert said == ""


def test_rows_around_missing_ones_are_not_compared() -> None:
    run, _ = recorded(unevenly=5e-4, lost=0.15, rows=3000)
    clock = Clock.of(run.time.numpy())
    assert clock is not None
    along, square = clock.shown(run.time.numpy(), run["qpos.hip"].numpy())
    assert along / square == pytest.approx(1.0, abs=0.05)


def test_of_both_the_part_that_shows_in_the_motion_is_kept() -> None:
    runs = [recorded(unevenly=4e-4, stamped=4e-4, seed=seed) for seed in range(3)]
    moved, said = read(*(run for run, _ in runs))
    for (run, taken), better in zip(runs, moved, strict=True):
        assert apart(better, taken) == pytest.approx(4e-4 / np.sqrt(2.0), rel=0.1)
        assert apart(better, taken) < 0.8 * apart(run, taken)
    assert "of that is kept" in said


@pytest.mark.parametrize(
    "options",
    [
        {"stamped": 0.0},  # even
        {"stamped": 4e-4, "speed": 0.02},  # too slow to tell
        {"stamped": 4e-4, "rows": 9},  # too short to be a run
        {"stamped": 4e-4, "wander": 5e-3},  # the even clock is not there
    ],
)
def test_nothing_is_changed_where_nothing_tells(options: dict) -> None:
    run, _ = recorded(**options)
    (same,), said = read(run)
    assert same is run
    assert said == ""


def test_a_pause_of_the_clock_is_no_scatter() -> None:
    run, _ = recorded(stamped=4e-4)
    time = run.time.numpy().copy()
    time[300:] += 0.014
    assert Clock.of(run.time.numpy()) is not None
    assert Clock.of(time) is None


def test_an_even_run_beside_one_that_scatters_stays_as_it_is() -> None:
    (even, _), (run, _) = recorded(seed=1), recorded(stamped=4e-4)
    (same, moved), said = read(even, run)
    assert same is even
    assert moved is not run
    assert said


def test_a_machine_is_laid_over_at_the_truer_times_and_says_so() -> None:
    runs = [recorded(stamped=4e-4, seed=seed) for seed in range(3)]
    machine = make_machine(MODEL, [run for run, _ in runs[:2]], [runs[2][0]])
    assert [run.label for run in machine.fit] == ["run0", "run1"]
    assert [run.label for run in machine.holdout] == ["run2"]
    for laid in (*machine.fit, *machine.holdout):
        assert np.ptp(laid.dt) < 1e-9
        assert laid.noise == pytest.approx([NOISE, NOISE], rel=0.25)
    assert sum("even clock" in note for note in machine.notes) == 1
