"""Recordings of a pendulum that turns sharply, whose positions somebody filtered forth and back afterwards."""

from __future__ import annotations

import copy
import dataclasses

import mujoco
import numpy as np
import pytest
from scipy import signal

from torch_activegp.data import Recording
from torch_activegp.diagnosis import diagnose
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine
from torch_activegp.diagnosis.inputs.runs import Channels, make_run
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.diagnosis.preparation import smeared_motion as module
from torch_activegp.diagnosis.preparation.filtered_rows import thinned
from torch_activegp.diagnosis.preparation.smeared_motion import given_back
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine

NOISE, ROWS, RATE, CORNER = 5e-4, 1251, 250, 15.0
FILTER = SteepFilter(CORNER / RATE, NOISE, (2, 2))


def moved(model: mujoco.MjModel, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, a control that knocks once, and how a machine that a model describes moves."""
    rng, time = np.random.default_rng(seed), np.arange(ROWS) / RATE
    control = np.sin(2 * np.pi * rng.uniform(0.3, 1.5, 3) * time[:, None]).sum(axis=1)
    control[570:580] += 40.0 * rng.choice([-1.0, 1.0])
    whole = Recording.from_columns("run", {"time": time, "qpos.hip": 0.1 * time, "ctrl.drive": control})
    run = make_run(whole, model, channels := Channels.of(model, [whole]))
    path = Engine(model, channels, 4).predict(cut([run], 1e9, 0.0), np.zeros((1, 1, 2)), [NOMINAL])[0, 0, :, 0]
    return time, control, path


def recordings(model: mujoco.MjModel, corner: float = CORNER, noise: float = NOISE) -> list[Recording]:
    found = []
    for seed in range(4):
        time, control, path = moved(model, seed)
        seen = path + noise * np.random.default_rng(seed + 50).normal(size=ROWS)
        seen = signal.filtfilt(*signal.butter(2, corner, fs=RATE), seen) if corner else seen
        found.append(Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": seen, "ctrl.drive": control}))
    return found


def machine_of(model: mujoco.MjModel, truth: mujoco.MjModel, corner: float = CORNER) -> Machine:
    runs = recordings(truth, corner)
    return make_machine(model, runs[:3], runs[3:])


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_what_a_filter_took_from_sharp_turns_is_given_back(model, damping: float) -> None:
    """Though something else is missing: the nominal in brief pieces knows it."""
    truth = copy.copy(model)
    truth.dof_damping[0] += damping
    machine = machine_of(model, truth)
    found, most = given_back(machine, [FILTER], 1)
    assert 2e-3 < most[0] < 2e-2
    pairs = zip((*machine.fit, *machine.holdout), (*found.fit, *found.holdout), strict=True)
    for seed, (before, after) in enumerate(pairs):
        path = moved(truth, seed)[2]
        off = [np.abs(run.position[60:-60, 0] - path[60:-60]).max() for run in (before, after)]
        assert off[0] > 2e-3
        assert off[1] < 2 * NOISE


@pytest.mark.parametrize(("gain", "limit"), [(0.6, np.inf), (1.4, np.inf), (1.0, 5.0)])
def test_nothing_is_given_back_where_the_nominal_turns_otherwise(model, gain: float, limit: float) -> None:
    """For what is missing is where the knock comes from: given back, it would be the nominal's."""
    truth = copy.copy(model)
    truth.actuator_gear[0, 0] *= gain
    truth.actuator_forcelimited[0], truth.actuator_forcerange[0] = np.isfinite(limit), (-min(limit, 99), min(limit, 99))
    machine = machine_of(model, truth)
    found, most = given_back(machine, [FILTER], 1)
    assert most.tolist() == [0.0]
    np.testing.assert_array_equal(found.fit[0].position, machine.fit[0].position)


def test_nothing_is_given_back_by_an_uneven_clock(model, monkeypatch) -> None:
    monkeypatch.setattr(module, "uneven", lambda run: run.label == "run1")
    machine = machine_of(model, model)
    assert given_back(machine, [FILTER], 1)[0] is machine


def test_rows_that_do_not_count_have_no_say(model) -> None:
    """Here all but a few: what these show is too uncertain."""
    machine = machine_of(model, model)
    lost = np.arange(ROWS) > 300
    blind = tuple(dataclasses.replace(run, left_out=lost) for run in machine.fit)
    assert given_back(dataclasses.replace(machine, fit=blind), [FILTER], 1)[1].tolist() == [0.0]


def test_held_out_runs_have_no_say(model) -> None:
    """Of a recorder that filtered no fitted run."""
    raw, filtered = recordings(model, 0.0), recordings(model)
    machine = make_machine(model, raw[:3], filtered[3:])
    found, most = given_back(machine, [FILTER], 1)
    assert most.tolist() == [0.0]
    np.testing.assert_array_equal(found.holdout[0].position, machine.holdout[0].position)


@pytest.mark.parametrize("corner", [0.0, 60.0])
def test_nothing_is_given_back_that_is_not_missing(model, corner: float) -> None:
    """Where the positions never passed such a filter, or only a quicker one."""
    machine = machine_of(model, model, corner)
    found, most = given_back(machine, [FILTER], 1)
    assert most.tolist() == [0.0]
    for before, after in zip(machine.fit, found.fit, strict=True):
        np.testing.assert_array_equal(after.position, before.position)


def test_without_a_filter_nothing_is_simulated(model, monkeypatch) -> None:
    machine = machine_of(model, model)
    monkeypatch.setattr(Engine, "predict", lambda *_: pytest.fail("simulated"))
    assert given_back(machine, [None], 1)[0] is machine


def test_pieces_that_fail_stay_as_they_are(model, monkeypatch) -> None:
    machine, predict = machine_of(model, model), Engine.predict

    def failing(self, segments, starts, candidates):
        read = predict(self, segments, starts, candidates)
        read[:, 3] = np.nan
        return read

    whole, _ = given_back(machine, [FILTER], 1)
    monkeypatch.setattr(Engine, "predict", failing)
    found, _ = given_back(machine, [FILTER], 1)
    pairs = zip(found.fit, machine.fit, whole.fit, strict=True)
    same = [(one.position == before.position) & (after.position != before.position) for one, before, after in pairs]
    assert 0 < np.concatenate(same).sum() < 120


def test_a_machine_that_turns_sharply_behind_a_filter_shows_no_mismatch(model) -> None:
    """The nominal left 30 times the noise, and that was `unknown`."""
    machine = machine_of(model, model)
    assert "is given back as the model tells it" in thinned(machine, 1).notes[-1]
    runs = recordings(model)
    found = diagnose(model, runs[:3], runs[3:], nthread=1)
    assert found.verdict == "none"
    assert found.details["mismatch"]["chi2_per_dof"] < 1.3
