from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import signal

from torch_activegp.data import Recording
from torch_activegp.diagnosis import diagnose
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.runs import Channels, make_run
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.diagnosis.noise import floor
from torch_activegp.diagnosis.noise.floor import noise_floor
from torch_activegp.diagnosis.preparation import filtered_rows
from torch_activegp.diagnosis.preparation.filtered_rows import thinned
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine

NOISE, ROWS, RATE = 2e-3, 1251, 250


def recordings(model, corner: float) -> list[Recording]:
    """Runs of the model itself at 250 Hz whose positions a filter passed forth and back."""
    found = []
    for seed in range(4):
        rng, time = np.random.default_rng(seed), np.arange(ROWS) / RATE
        control = 2.0 * np.sin(2 * np.pi * rng.uniform(0.3, 1.5, 3) * time[:, None]).sum(axis=1)
        whole = Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": 0.1 * time, "ctrl.drive": control})
        run = make_run(whole, model, channels := Channels.of(model, [whole]))
        path = Engine(model, channels, 4).predict(cut([run], 1e9, 0.0), np.zeros((1, 1, 2)), [NOMINAL])[0, 0, :, 0]
        seen = signal.filtfilt(*signal.butter(2, corner, fs=RATE), path + NOISE * rng.normal(size=ROWS))
        found.append(Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": seen, "ctrl.drive": control}))
    return found


def test_only_rows_count_in_which_noise_is_new(model) -> None:
    whole = make_machine(model, recordings(model, 30.0), [])
    found = thinned(whole)
    assert "filtered at about" in found.notes[-1]
    assert "of all joints one row in 16 ms counts" in found.notes[-1]
    for one, other in zip(whole.fit, found.fit, strict=True):
        counted = np.flatnonzero(one.counted[: ROWS - 8])[8:]  # not at the ends, where the filter met none
        assert np.flatnonzero(other.counted).tolist() == counted[::4].tolist()
        assert other.recorded.all()
    assert [run.left_out is None for run in found.holdout] == [True] * len(whole.holdout)


def test_rows_that_were_left_out_before_stay_so(model) -> None:
    whole = make_machine(model, recordings(model, 30.0), [])
    lost = np.arange(ROWS) % 7 == 0
    glitchy = dataclasses.replace(whole, fit=tuple(dataclasses.replace(run, left_out=lost) for run in whole.fit))
    for run in thinned(glitchy).fit:
        assert not (run.counted & lost).any()
        assert np.diff(run.time[run.counted]).min() > 3.5 / RATE
        assert run.counted.sum() > 0.8 * ROWS / 4


def test_rows_of_a_slower_recording_are_as_far_apart(model) -> None:
    """On the clock of the fastest, every second row of the slower one was recorded."""
    runs = recordings(model, 30.0)
    names = ("time", "qpos.hip", "ctrl.drive")
    slow = Recording.from_columns("slow", {name: runs[0][name].numpy()[::2] for name in names})
    found = thinned(make_machine(model, [*runs[1:], slow], [runs[0]]))
    for run in found.fit:
        assert np.diff(run.time[run.counted]) == pytest.approx(4 / RATE, abs=1e-9)


def test_what_no_steep_filter_passed_stays_as_it_is(clean) -> None:
    found = thinned(clean.machine)
    assert found.notes == clean.machine.notes
    assert [run.filters for run in found.fit] == [(None,)] * len(clean.machine.fit)
    assert all(run.left_out is None for run in found.fit)


def test_behind_a_quick_filter_each_row_says_something_new(clean, monkeypatch) -> None:
    quick = SteepFilter(0.4, 1e-3)
    monkeypatch.setattr(filtered_rows, "steep_filters", lambda runs: [quick])
    found = thinned(clean.machine)
    assert found.notes[-1].startswith("qpos.hip: filtered at about 40 Hz")
    assert "counts" not in found.notes[-1]
    assert all(run.left_out is None for run in found.fit)
    assert noise_floor(found.fit).scale == quick.scale


def test_a_filter_that_shows_in_what_is_left_counts_too(clean, monkeypatch) -> None:
    slow = SteepFilter(0.1, 1e-3)
    monkeypatch.setattr(filtered_rows, "filters_left", lambda machine, nthread: [slow])
    found = thinned(clean.machine)
    assert [run.filters for run in found.fit] == [(slow,)] * len(found.fit)
    assert "one row in 50 ms" in found.notes[-1]


def test_a_filter_counts_for_a_joint_beside_another_one_that_shows_it(clean, monkeypatch) -> None:
    """Here of two channels; what the first one shows stays, and what the second is beside it is found once more."""
    slow, own = SteepFilter(0.1, 1e-3), SteepFilter(0.1, 2e-3)
    channels = clean.machine.channels
    two = dataclasses.replace(channels, joints=(*channels.joints, "knee"))
    asked = []

    def filter_beside(runs, channel, shown):
        asked.append((channel, list(shown)))
        return own

    monkeypatch.setattr(filtered_rows, "steep_filters", lambda runs: [None, None])
    monkeypatch.setattr(filtered_rows, "filters_left", lambda machine, nthread: [slow, None])
    monkeypatch.setattr(filtered_rows, "filter_beside", filter_beside)
    monkeypatch.setattr(filtered_rows, "given_back", lambda machine, filters, nthread: (machine, np.zeros(2)))
    found = thinned(dataclasses.replace(clean.machine, channels=two))
    assert [run.filters for run in found.fit] == [(slow, own)] * len(clean.machine.fit)
    assert asked == [(1, [slow, None])]
    assert "one row in 50 ms" in found.notes[-1]


@pytest.mark.parametrize("counts", [True, False])
def test_filtered_positions_of_the_model_itself_are_no_mismatch(model, monkeypatch, counts: bool) -> None:
    """Unless every row counts, for noise that follows from the rows around is not seen by differences."""
    if not counts:
        for module in (filtered_rows, floor):
            monkeypatch.setattr(module, "steep_filters", lambda runs: [None])
        monkeypatch.setattr(filtered_rows, "filters_left", lambda machine, nthread: [None])
    found = diagnose(model, recordings(model, 30.0), nthread=1)
    assert (found.verdict == "none") == counts


@pytest.mark.parametrize(("most", "scales"), [(0.0, (2e-3, 1e-3)), (5e-3, (1e-3, 1e-3))])
def test_noise_is_measured_again_where_motion_was_given_back(clean, monkeypatch, most, scales) -> None:
    """There alone, below the corner that was known: of a filter of four times that corner a quarter of the variance."""
    channels = dataclasses.replace(clean.machine.channels, joints=("hip", "knee"), hinge=np.array([True, True]))
    before, after = [SteepFilter(0.1, 2e-3), SteepFilter(0.1, 1e-3)], [SteepFilter(0.4, 2e-3), SteepFilter(0.1, 5e-4)]
    monkeypatch.setattr(filtered_rows, "steep_filters", lambda runs: before)
    monkeypatch.setattr(filtered_rows, "filters_left", lambda machine, nthread: after)
    monkeypatch.setattr(filtered_rows, "given_back", lambda machine, *_: (machine, np.array([most, 0.0])))
    found = thinned(dataclasses.replace(clean.machine, channels=channels))
    assert found.fit[0].filters == tuple(SteepFilter(0.1, scale) for scale in scales)
    assert ("up to 0.005 rad of qpos.hip from the motion" in found.notes[-1]) == (most > 0.0)
    assert "qpos.knee from" not in found.notes[-1]


def test_of_a_short_piece_a_tenth_does_not_count(model) -> None:
    machine = make_machine(model, recordings(model, 30.0), [])
    short = [dataclasses.replace(filtered_rows._apart(run, 0.016, 8)) for run in machine.fit]
    assert np.flatnonzero(short[0].counted)[0] == 8
    few = machine.fit[0]
    rows = {name: getattr(few, name)[:40] for name in ("time", "position", "recorded", "velocity", "smooth")}
    piece = dataclasses.replace(few, control=few.control[:39], force=few.force[:39], **rows)
    counted = np.flatnonzero(filtered_rows._apart(piece, 0.016, 8).counted)
    assert counted.tolist() == list(range(4, 36, 4))
