"""Recorded times that scatter, of machines that were sampled evenly, unevenly, or in between."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest
import torch

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.clock import Clock, Shown, truer_times
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.runs import Channels
from torch_activegp.diagnosis.inputs.source import read_source
from torch_activegp.simulators import ActionSpace, FunctionSimulator, StateSpace

STEP, NOISE = 0.01, 3e-4
MODEL = mujoco.MjModel.from_xml_string(
    """<mujoco><worldbody><body><joint name="hip" axis="0 1 0"/><geom size=".1"/>
    <body pos="0 0 .3"><joint name="slide" type="slide"/><geom size=".1"/></body></body></worldbody></mujoco>"""
)


def recorded(
    unevenly: float = 0.0,
    stamped: float = 0.0,
    seed: int = 0,
    rows: int = 1500,
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
    assert "their rows are taken to be even" in said
    assert moved["qpos.hip"].equal(run["qpos.hip"])


@pytest.mark.parametrize(("lost", "scatter"), [(0.0, 0.27), (0.2, 0.25)])
def test_rows_are_counted_by_more_than_the_step_between_two_of_them(lost: float, scatter: float) -> None:
    """Neighbours that are stamped far apart miss none between them, those that are near each other may."""
    rng = np.random.default_rng(0)
    rows = np.arange(4000)[rng.random(4000) >= lost]
    time = STEP * (rows + rng.uniform(-scatter, scatter, size=len(rows)))
    alone = np.maximum(np.rint(np.diff(time) / np.median(np.diff(time))), 1.0)
    assert (alone != np.diff(rows)).any()
    clock = Clock.of(time)
    assert clock is not None
    np.testing.assert_allclose(clock.even, STEP * rows, atol=0.05 * STEP)


def test_what_leaps_does_not_hide_the_clock() -> None:
    run, taken = recorded(stamped=4e-4)
    hip = run["qpos.hip"].clone()
    hip[100::100] += 0.3
    (moved,), _ = read(run.replace({"qpos.hip": hip}))
    assert apart(moved, taken) < 4e-5


@pytest.mark.parametrize(
    "options", [{}, {"lost": 0.04, "speed": 9.0}, {"turns": True}, {"unevenly": 2e-3}, {"wander": 5e-3}]
)
def test_times_of_rows_that_were_taken_unevenly_stay(options: dict) -> None:
    run, _ = recorded(**{"unevenly": 5e-4, **options})
    (same,), said = read(run)
    assert same is run
    assert said == ""


def test_rows_around_missing_ones_are_not_compared() -> None:
    run, _ = recorded(unevenly=5e-4, lost=0.15, rows=3000)
    clock = Clock.of(run.time.numpy())
    assert clock is not None
    shown = Shown.by(clock.shown(run.time.numpy(), run["qpos.hip"].numpy()))
    assert shown.share == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("unevenly", "stamped", "even"), [(1e-4, 4e-4, True), (4e-4, 4e-4, False), (4e-4, 1e-4, False)]
)
def test_rows_are_even_where_less_than_a_quarter_of_the_scatter_shows(
    unevenly: float, stamped: float, even: bool
) -> None:
    runs = [recorded(unevenly=unevenly, stamped=stamped, seed=seed)[0] for seed in range(3)]
    moved, said = read(*runs)
    assert bool(said) == even
    assert [one is run for one, run in zip(moved, runs, strict=True)] == [not even] * 3


def test_the_share_is_that_of_the_variance() -> None:
    run, _ = recorded(unevenly=3e-4, stamped=4e-4, rows=4000)
    clock = Clock.of(run.time.numpy())
    assert clock is not None
    shown = Shown.by(clock.shown(run.time.numpy(), run["qpos.hip"].numpy()))
    assert shown.share == pytest.approx(0.36, abs=0.08)
    assert clock.off.std() == pytest.approx(5e-4, rel=0.05)


def test_blocks_that_disagree_say_less_and_a_few_nothing() -> None:
    noise = np.random.default_rng(0).normal(size=(60, 1))
    alike = np.full((60, 2), [0.0, 1e4])
    assert Shown.by(alike).even
    assert not Shown.by(alike + 2e4 * np.hstack([noise, np.zeros_like(noise)])).even
    assert Shown.by(alike).error < 0.01
    few = alike.copy()
    few[5:] *= 1e-3
    assert not Shown.by(few).even
    assert Shown.by(few).blocks == pytest.approx(5.0, rel=0.05)
    assert not Shown.by(-0.8 * alike[:, ::-1] + alike).even  # the other way round


def test_any_joint_may_show_it() -> None:
    run, taken = recorded(stamped=4e-4)
    still = NOISE * np.random.default_rng(1).normal(size=len(taken))
    (moved,), _ = read(run.replace({"qpos.hip": torch.from_numpy(still)}))
    assert apart(moved, taken) < 4e-5


def test_knocks_do_not_rewrite_right_times() -> None:
    """A ring of 8 Hz every two seconds, of which few rows are fast, and the speed at its start is not seen."""
    changed = 0
    for seed in range(6):
        run, taken = recorded(unevenly=5e-4, seed=seed, rows=3000, speed=0.0)
        since = taken % 2.0
        ring = 0.02 * np.exp(-8.0 * since) * np.sin(2.0 * np.pi * 8.0 * since)
        noise = 2e-5 * np.random.default_rng(seed).normal(size=(2, 3000))
        rung = {"qpos.hip": torch.from_numpy(ring + noise[0]), "qpos.slide": torch.from_numpy(noise[1])}
        changed += bool(read(run.replace(rung))[1])
    assert changed == 0


def test_positions_a_row_late_do_not_rewrite_right_times() -> None:
    run, _ = recorded(unevenly=5e-4, rows=2000)
    late = {name: torch.roll(run[name], 1) for name in ("qpos.hip", "qpos.slide")}
    assert read(run.replace(late))[1] == ""


def test_a_run_of_another_logger_is_judged_alone() -> None:
    (right, _), (stamped, taken) = recorded(unevenly=4e-4, rows=1500), recorded(stamped=4e-4, rows=1500, seed=1)
    (same, moved), said = read(right, stamped)
    assert same is right
    assert apart(moved, taken) < 4e-5
    assert "times of run1 scatter" in said


@pytest.mark.parametrize(
    "options",
    [
        {"stamped": 0.0},  # even
        {"stamped": 4e-4, "speed": 0.02},  # too slow to tell
        {"stamped": 4e-4, "rows": 9},  # too short to be a run
        {"stamped": 4e-4, "wander": 5e-3},  # the even clock is not there
        {"stamped": 5e-4, "wander": 5e-4, "rows": 3000},  # nor there
    ],
)
def test_nothing_is_changed_where_nothing_tells(options: dict) -> None:
    run, _ = recorded(**options)
    (same,), said = read(run)
    assert same is run
    assert said == ""


def test_a_clock_that_is_even_or_misses_half_of_its_rows_tells_nothing() -> None:
    run, _ = recorded()
    assert Clock.of(run.time.numpy()) is None
    sparse, _ = recorded(stamped=4e-4, lost=0.8)
    assert read(sparse)[1] == ""
    stamped, _ = recorded(stamped=4e-4)
    coarse = {name: (stamped[name] / 100.0).round() for name in ("qpos.hip", "qpos.slide")}
    assert read(stamped.replace(coarse))[1] == ""


def test_a_pause_of_the_clock_is_no_scatter() -> None:
    run, _ = recorded(stamped=4e-4)
    time = run.time.numpy().copy()
    time[700:] += 0.014
    assert Clock.of(run.time.numpy()) is not None
    assert Clock.of(time) is None


def test_an_even_run_beside_one_that_scatters_stays_as_it_is() -> None:
    (even, _), (run, _) = recorded(seed=1), recorded(stamped=4e-4)
    (same, moved), said = read(even, run)
    assert same is even
    assert moved is not run
    assert said


def test_a_black_box_gets_rows_of_its_own_clock_back() -> None:
    def step(state: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        return torch.stack([state[..., 0] + STEP * state[..., 1], state[..., 1] + STEP * action[..., 0]], dim=-1)

    space = StateSpace(["qpos.hip", "qvel.hip"], -np.inf, np.inf, angles=[0])
    source = read_source(FunctionSimulator(step, space, ActionSpace(["push"], -1.0, 1.0), dt=STEP))
    run, _ = recorded(stamped=4e-4)
    hip = Recording.from_columns("hip", {"time": run["time"], "qpos.hip": run["qpos.hip"]})
    machine = make_machine(source.model, [hip], [], source.box)
    assert any("their rows are taken to be even" in note for note in machine.notes)
    assert np.ptp(machine.fit[0].dt) < 1e-9


def test_a_machine_is_laid_over_at_the_truer_times_and_says_so() -> None:
    runs = [recorded(stamped=4e-4, seed=seed) for seed in range(3)]
    machine = make_machine(MODEL, [run for run, _ in runs[:2]], [runs[2][0]])
    assert [run.label for run in machine.fit] == ["run0", "run1"]
    assert [run.label for run in machine.holdout] == ["run2"]
    for laid in (*machine.fit, *machine.holdout):
        assert np.ptp(laid.dt) < 1e-9
        assert laid.noise == pytest.approx([NOISE, NOISE], rel=0.25)
    assert sum("even clock" in note for note in machine.notes) == 1
