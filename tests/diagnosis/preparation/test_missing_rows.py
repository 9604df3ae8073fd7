from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis import diagnose, evaluate
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine
from torch_activegp.diagnosis.inputs.runs import Channels, make_run
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.preparation import missing_rows as module
from torch_activegp.diagnosis.preparation.missing_rows import as_the_machine_moved, moved
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine

NOISE, ROWS = 2e-4, 401


def recordings(model: mujoco.MjModel, goes_on: bool, uneven: float = 0.0, noise: float = NOISE) -> list[Recording]:
    """Runs of the model itself at 100 Hz in which one row of twelve is missing; what moved it went on there, or not.

    Rows were taken `uneven` seconds too early or too late.
    """
    found = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        time, kept = np.arange(ROWS) / 100, rng.random(ROWS) > 1 / 12
        time = time + uneven * np.random.default_rng(seed + 9).uniform(-1.0, 1.0, ROWS)
        kept[:2] = True
        control = 3.0 * np.sin(2 * np.pi * rng.uniform(1.0, 3.0, 3) * time[:, None]).sum(axis=1)
        if not goes_on:
            control = control[np.maximum.accumulate(np.where(kept, np.arange(ROWS), 0))]
        whole = Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": 0.1 * time, "ctrl.drive": control})
        run = make_run(whole, model, channels := Channels.of(model, [whole]))
        engine = Engine(model, channels, 4)
        segment = cut([run], 1e9, 0.0)
        path = engine.predict(segment, np.zeros((1, 1, 2)), [NOMINAL])[0, 0, :, 0] + noise * rng.normal(size=ROWS)
        columns = {"time": time, "qpos.hip": path, "ctrl.drive": control}
        found.append(Recording.from_columns(f"run{seed}", {name: column[kept] for name, column in columns.items()}))
    return found


def machine_of(model: mujoco.MjModel, goes_on: bool) -> Machine:
    first, second = recordings(model, goes_on)
    return make_machine(model, [first], [second])


def moves_between(held: Machine, found: Machine) -> bool:
    return bool((held.fit[0].control != found.fit[0].control).any())


@pytest.mark.parametrize("goes_on", [True, False])
def test_controls_in_missing_rows_are_what_the_motion_agrees_with(model, goes_on: bool) -> None:
    held = machine_of(model, goes_on)
    found = as_the_machine_moved(held, 1)
    assert moves_between(held, found) == goes_on
    if not goes_on:
        assert found.notes == held.notes
        assert [run.unsure for run in found.fit] == [None]
        return
    assert found.notes[:-1] == held.notes
    assert "Controls are taken as on their way" in found.notes[-1]
    for one, other in zip((*held.fit, *held.holdout), (*found.fit, *found.holdout), strict=True):
        missing = ~one.recorded[:-1]
        pairs = zip((*held.fit, *held.holdout), (*found.fit, *found.holdout), strict=True)
        count = sum((one.control != other.control).any(axis=1).sum() for one, other in pairs)
        assert found.notes[-1].startswith(f"{count} rows")
        np.testing.assert_array_equal(other.control[~missing], one.control[~missing])
        np.testing.assert_array_equal(other.control, moved(one, 3).control)


def test_rows_that_come_early_and_late_are_missing_too(model) -> None:
    """A gap of two rows of an uneven clock is a little shorter than two of its median one in every second case."""
    (run, _), (even, _) = (
        [make_run(one, model, Channels.of(model, [one])) for one in recordings(model, True, uneven)]
        for uneven in (1e-3, 0.0)
    )
    missing = module._in_gaps(run)[0]
    np.testing.assert_array_equal(missing, ~run.recorded[:-1])
    assert missing.sum() == (~even.recorded).sum() > 20
    assert (moved(run, 1).control[missing] != run.control[missing]).all()


@pytest.mark.parametrize(
    ("goes_on", "noise", "rows", "moves"),
    [
        (True, 4e-4, [14], True),
        (True, 2e-3, [14, 26], True),  # 60 ms are six rows too
        (False, 2e-3, [14, 26, 52], False),
        (True, 0.1, [14, 26, 52, 101], False),  # nothing tells
    ],
)
def test_pieces_around_gaps_grow_until_one_way_agrees_better(
    model, monkeypatch, goes_on: bool, noise: float, rows: list[int], moves: bool
) -> None:
    first, second = recordings(model, goes_on, noise=noise)
    held, seen, lay = make_machine(model, [first], [second]), [], module.lay
    monkeypatch.setattr(module, "lay", lambda runs, pieces: seen.append(lay(runs, pieces)) or seen[-1])
    found = as_the_machine_moved(held, 1)
    assert moves_between(held, found) == moves
    assert [segments.intervals for segments in seen[::2] if segments.runs[0].label == first.label] == rows
    (one,), (before,) = found.fit, held.fit
    if noise == 0.1:
        np.testing.assert_array_equal(one.unsure, moved(before, 3).control - before.control)


def test_a_run_that_says_for_itself_what_its_controls_did_is_heard(model) -> None:
    """A chirp that went on beside a staircase that stood still; a run that says nothing is as the others are."""
    (on, _), (_, still) = (recordings(model, goes_on) for goes_on in (True, False))
    held = make_machine(model, [on], [still])
    found = as_the_machine_moved(held, 1)
    assert moves_between(held, found)
    np.testing.assert_array_equal(found.holdout[0].control, held.holdout[0].control)
    (silent,) = (one for one in recordings(model, False, noise=0.1) if one.label == "run1")
    held = make_machine(model, [on], [silent])
    found = as_the_machine_moved(held, 1)
    np.testing.assert_array_equal(found.holdout[0].control, moved(held.holdout[0], 3).control)
    held = make_machine(model, [still], [silent])
    found = as_the_machine_moved(held, 1)
    np.testing.assert_array_equal(found.holdout[0].control, held.holdout[0].control)
    assert found.notes == held.notes


def test_longer_pieces_are_looked_at_for_a_run_that_leans_the_other_way(model, monkeypatch) -> None:
    (on, _), (_, still) = recordings(model, True), recordings(model, False, noise=1e-3)
    held = make_machine(model, [on], [still])
    for leans, heard in ((2.0, True), (np.inf, False)):
        monkeypatch.setattr(module, "_LEANS", leans)
        control = as_the_machine_moved(held, 1).holdout[0].control
        assert bool((control == held.holdout[0].control).all()) is heard


def test_longer_pieces_are_looked_at_where_nothing_else_is_missing(model, monkeypatch) -> None:
    first, second = recordings(model, True, noise=1e-2)
    held, seen, lay = make_machine(model, [first], [second]), [], module.lay
    monkeypatch.setattr(module, "lay", lambda runs, pieces: seen.append(lay(runs, pieces)) or seen[-1])
    for quiet, rows, longest in ((1.5, 6, 102), (0.1, 6, 26), (0.1, 12, 26)):  # in so many rows brief pieces are alike
        monkeypatch.setattr(module, "_QUIET", quiet)
        monkeypatch.setattr(module, "_ROWS", rows)
        as_the_machine_moved(held, 1)
        assert seen[-1].intervals == longest


def test_a_held_out_run_with_gaps_is_asked_though_no_fitted_one_has_any(model, record) -> None:
    held = make_machine(model, [record("none", 5)], recordings(model, True)[:1])
    found = as_the_machine_moved(held, 1)
    np.testing.assert_array_equal(found.holdout[0].control, moved(held.holdout[0], 3).control)
    assert (found.holdout[0].control != held.holdout[0].control).any()


def test_held_out_runs_have_no_say_in_what_is_fitted(model) -> None:
    """Something else moved the second one, in which brief pieces alone would be looked at."""
    first, second = recordings(model, True, noise=3e-3)
    columns = {name: second[name].numpy() for name in second.columns}
    shaken = columns["qpos.hip"] + 0.3 * np.sin(12.0 * columns["time"])
    other = Recording.from_columns("shaken", columns | {"qpos.hip": shaken})
    fitted = [as_the_machine_moved(make_machine(model, [first], [one]), 1).fit[0] for one in (second, other)]
    np.testing.assert_array_equal(fitted[0].control, moved(make_machine(model, [first], [second]).fit[0], 3).control)
    np.testing.assert_array_equal(fitted[1].control, fitted[0].control)


@pytest.mark.parametrize(("seconds", "begins"), [(0.03, [14, 34, 54]), (0.12, [8, 48])])
def test_pieces_around_gaps_do_not_overlap(model, seconds: float, begins: list[int]) -> None:
    time = np.arange(80) * 0.01
    columns = {"time": time, "qpos.hip": np.sin(time), "ctrl.drive": np.sin(40.0 * time)}
    gaps = Recording.from_columns("gaps", {name: np.delete(col, [20, 40, 60]) for name, col in columns.items()})
    runs = [make_run(gaps, model, Channels.of(model, [gaps]))] * 2
    found = module._around_gaps(runs, seconds)
    assert [first for number, first, _, _ in found if number == 0] == begins
    assert [first for number, first, _, _ in found if number == 1] == begins


def test_controls_go_on_along_splines_of_a_degree(model) -> None:
    time = np.arange(40) * 0.01
    columns = {"time": time, "qpos.hip": np.sin(time), "ctrl.drive": 1e3 * time**2}
    gaps = Recording.from_columns("gaps", {name: np.delete(column, [10, 20, 21]) for name, column in columns.items()})
    run = make_run(gaps, model, Channels.of(model, [gaps]))
    straight, curved = (moved(run, degree).control[:, 0] for degree in (1, 3))
    np.testing.assert_allclose(curved, columns["ctrl.drive"][:-1], atol=1e-9)
    np.testing.assert_allclose(straight[[10, 20, 21]], [10.1, 40.2 + 0.5, 44.4 + 0.1], atol=0.5)
    np.testing.assert_allclose(straight[10], (8.1 + 12.1) / 2)


@pytest.mark.parametrize(("degree", "wrong"), [(1, [0.1, 0.225, 0.225]), (3, [0.0] * 3)])
def test_guesses_are_as_unsure_as_they_would_be_at_the_recorded_row_before(model, degree: int, wrong) -> None:
    """Of a parabola, lines miss the middle by half its curvature, more in longer gaps, and splines nothing."""
    time = np.arange(40) * 0.01
    columns = {"time": time, "qpos.hip": np.sin(time), "ctrl.drive": 1e3 * time**2}
    gaps = Recording.from_columns("gaps", {name: np.delete(column, [10, 20, 21]) for name, column in columns.items()})
    run = make_run(gaps, model, Channels.of(model, [gaps]))
    assert run.unsure is None
    unsure = moved(run, degree).unsure[:, 0]
    np.testing.assert_allclose(unsure[[10, 20, 21]], wrong, atol=1e-9)
    assert not np.delete(unsure, [10, 20, 21]).any()


def test_guesses_of_a_slow_recording_are_told_by_its_own_rows(model) -> None:
    time, rng = np.arange(60) * 0.02, np.random.default_rng(0)
    columns = {"time": time, "qpos.hip": np.sin(time), "ctrl.drive": rng.normal(size=60)}
    slow = Recording.from_columns("slow", {name: np.delete(column, [20, 40]) for name, column in columns.items()})
    run = make_run(slow, model, Channels.of(model, [slow]), clock=0.01)
    found = moved(run, 1)
    assert found.unsure is not None
    assert (found.unsure != 0.0).any(axis=1).sum() == 4
    u = run.control[::2, 0]
    np.testing.assert_allclose(found.unsure[[40, 41], 0], 0.5 * (u[16] + u[18]) - u[17])


def test_controls_of_a_slow_recording_are_held_between_its_rows(model) -> None:
    """It is no gap that another recording is faster."""
    time = np.arange(40) * 0.02
    slow = Recording.from_columns("slow", {"time": time, "qpos.hip": np.sin(time), "ctrl.drive": time})
    gap = Recording.from_columns("gap", {name: np.delete(slow[name].numpy(), 10) for name in slow.columns})
    one, other = (make_run(some, model, Channels.of(model, [some]), clock=0.01) for some in (slow, gap))
    np.testing.assert_array_equal(moved(one, 1).control, one.control)
    np.testing.assert_allclose(moved(other, 1).control[18:23, 0], [0.18, 0.18, 0.20, 0.20, 0.22])


def test_without_missing_rows_nothing_is_simulated(clean, monkeypatch) -> None:
    monkeypatch.setattr(module, "numerics_of", lambda *_: pytest.fail("simulated"))
    assert as_the_machine_moved(clean.machine) is clean.machine


def test_a_machine_that_went_on_where_rows_are_missing_shows_no_mismatch(model) -> None:
    """Held, its controls left 2.4 times the noise, and a mismatch was seen."""
    runs = recordings(model, goes_on=True)
    found = diagnose(model, runs[:1], runs[1:], nthread=1)
    assert found.verdict == "none"
    assert found.details["mismatch"]["chi2_per_dof"] < 1.2
    assert any("rows are missing" in note for note in found.details["notes"])
    errors = evaluate(model, runs, nthread=1)
    assert errors["one_step"]["error"] < 1.3 * errors["one_step"]["noise"]
    assert any("rows are missing" in note for note in errors["notes"])


@pytest.mark.parametrize(("rough", "degree"), [(True, 1), (False, 3)])
def test_the_controls_themselves_say_whether_they_go_on_smoothly(clean, rough: bool, degree: int) -> None:
    rng, run = np.random.default_rng(0), clean.machine.fit[0]
    control = np.cumsum(rng.normal(size=run.control.shape), axis=0) if rough else run.control
    assert module._degree([dataclasses.replace(run, control=control)]) == degree
    idle = np.concatenate([control, np.full_like(control, 0.1)], axis=1)  # which three times itself is not thrice 0.1
    assert module._degree([dataclasses.replace(run, control=idle)]) == degree


def test_what_is_left_of_a_run_behind_a_gap_has_few_rows_or_none(clean) -> None:
    run = clean.machine.fit[0]
    for kept in ([0, 1, 20], [0, 20], [0], [5]):
        some = dataclasses.replace(run, recorded=np.isin(np.arange(len(run)), kept))
        straight, curved = (moved(some, degree).control for degree in (1, 3))
        np.testing.assert_array_equal(curved, straight)
        assert np.isfinite(straight).all()


def test_controls_stay_within_what_was_recorded(model) -> None:
    time = np.arange(200) * 0.01
    control = np.clip(2.0 * np.sin(6.0 * time), -1.0, 1.0)
    kept = np.arange(200) % 9 != 5
    columns = {"time": time, "qpos.hip": np.sin(time), "ctrl.drive": control}
    gaps = Recording.from_columns("gaps", {name: column[kept] for name, column in columns.items()})
    assert np.abs(moved(make_run(gaps, model, Channels.of(model, [gaps])), 3).control).max() == 1.0


def test_rows_of_a_faster_recording_are_not_missing(model) -> None:
    time = np.arange(60) * 0.02
    slow = Recording.from_columns("slow", {"time": time, "qpos.hip": np.sin(time), "ctrl.drive": time})
    run = make_run(slow, model, Channels.of(model, [slow]), clock=0.01)
    assert (~run.recorded).sum() == 59
    assert not module._in_gaps(run)[0].any()
    assert moved(run, 1) is run
