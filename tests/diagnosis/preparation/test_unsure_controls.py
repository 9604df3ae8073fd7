from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine
from torch_activegp.diagnosis.inputs.runs import Channels, Run, make_run
from torch_activegp.diagnosis.inputs.segments import cut, halve
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.lengths import longest, uncut
from torch_activegp.diagnosis.preparation.missing_rows import moved
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.preparation.unsure_controls import behind_gaps, unsure
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import NOMINAL
from torch_activegp.diagnosis.simulation.engine import Engine

NOISE, ROWS = 2e-4, 801


def machine_with_gaps(model, rough: float) -> Machine:
    """The model itself at 200 Hz with one row in forty missing; its control moves smoothly, but for a rough part."""
    rng, time = np.random.default_rng(0), np.arange(ROWS) / 200
    kept = np.arange(ROWS) % 40 != 30
    control = 2.0 * np.sin(9.0 * time) + rough * rng.normal(size=ROWS)
    whole = Recording.from_columns("run", {"time": time, "qpos.hip": 0.1 * time, "ctrl.drive": control})
    run = make_run(whole, model, channels := Channels.of(model, [whole]))
    path = Engine(model, channels, 2).predict(cut([run], 1e9, 0.0), np.zeros((1, 1, 2)), [NOMINAL])[0, 0, :, 0]
    columns = {"time": time, "qpos.hip": path + NOISE * rng.normal(size=ROWS), "ctrl.drive": control}
    gaps = Recording.from_columns("gaps", {name: column[kept] for name, column in columns.items()})
    held = make_machine(model, [gaps], [whole])
    return dataclasses.replace(held, fit=tuple(moved(one, 1) for one in held.fit))


def recording_of(run: Run) -> Recording:
    return Recording.from_columns("run", {"time": run.time, "qpos.hip": run.position[:, 0]})


@pytest.mark.parametrize("rough", [0.0, 0.3])
def test_segments_are_cut_at_gaps_where_guessed_controls_matter(model, rough: float) -> None:
    machine = machine_with_gaps(model, rough)
    found = longest(machine, Numerics.of(machine, 1), NoiseModel.white(np.array([NOISE])), 1e9)
    assert found.halved == bool(rough)
    if rough:
        (run,) = machine.fit
        begins = set(found.segments.scored[:, 0].tolist()) - set(uncut(machine).scored[:, 0].tolist())
        assert begins
        assert all(run.recorded[row] and not run.recorded[row - 1] for row in begins)
        left = found.nominal.chi2 / found.segments.samples.sum()
        assert left < 1.3
        assert found.uncut.chi2 / uncut(machine).samples.sum() > left + 0.3


@pytest.mark.parametrize(("rough", "step", "shows"), [(0.0, 5e-4, False), (2.0, 5e-4, True), (2.0, 1e-9, False)])
def test_a_rounded_clock_matters_where_controls_leap(model, rough: float, step: float, shows: bool) -> None:
    """It says when they do so."""
    run, rng = machine_with_gaps(model, 0.0).fit[0], np.random.default_rng(0)
    time = np.round((run.time + 1e-3 * rng.uniform(-1.0, 1.0, len(run.time))) / step) * step
    control = run.control + rough * rng.normal(size=run.control.shape)
    rounded = dataclasses.replace(run, time=time, control=control, unsure=None, recorded=np.ones_like(run.recorded))
    segments, engine = cut([rounded], 1.0, 0.0), Engine(model, Channels.of(model, [recording_of(run)]), 2)
    shooting = Shooting(engine, segments, NoiseModel.white(np.array([NOISE])))
    fit = shooting.fit([((), ())], engine.starts(segments), rounds=1, hold=True)[0]
    assert unsure(shooting, fit).any() == shows


def test_known_controls_are_not_simulated_twice(bench, monkeypatch) -> None:
    monkeypatch.setattr(type(bench.shooting), "predicted", lambda *_: pytest.fail("simulated"))
    assert not unsure(bench.shooting, bench.nominal).any()


def test_what_initial_states_make_up_for_is_sure(model) -> None:
    """A leap of the speed in the first interval of a segment is another initial speed."""
    machine = machine_with_gaps(model, 0.0)
    numerics, (run,) = Numerics.of(machine, 1), machine.fit
    segments = cut(machine.fit, 0.5, 0.0)
    shooting = Shooting(numerics.fine, segments, NoiseModel.white(np.array([NOISE])))
    fit = shooting.fit([((), ())], numerics.fine.starts(segments))[0]
    first, last = segments.scored[1]
    for row, shows in ((first, False), ((first + last) // 2, True)):
        guess = np.zeros_like(run.control)
        guess[row] = 1.0
        other = dataclasses.replace(segments, runs=(dataclasses.replace(run, unsure=guess),))
        found = unsure(dataclasses.replace(shooting, segments=other), fit)
        assert found[1] == shows
        assert not np.delete(found, 1).any()


def test_the_first_piece_ends_with_the_gap_nearest_to_the_middle(bench) -> None:
    run = bench.machine.fit[0]
    recorded = np.ones(len(run), dtype=bool)
    recorded[[5, 75, 76, 115, 116]] = False
    segments = cut([dataclasses.replace(run, recorded=recorded)], 1e9, 0.0)
    last = int(segments.scored[0, 1])
    (share,) = behind_gaps(segments)
    assert halve(segments, np.array([True]), share).scored.tolist() == [[0, 117], [117, last]]
    recorded[30:] = True  # one near an end alone
    for rows in (np.ones_like(recorded), recorded):
        assert behind_gaps(cut([dataclasses.replace(run, recorded=rows)], 1e9, 0.0)).tolist() == [0.5]


def test_what_fails_by_one_of_the_ways_alone_is_unsure(model, monkeypatch) -> None:
    machine = machine_with_gaps(model, 0.0)
    numerics, segments = Numerics.of(machine, 1), cut(machine.fit, 0.5, 0.0)
    shooting = Shooting(numerics.fine, segments, NoiseModel.white(np.array([NOISE])))
    fit = shooting.fit([((), ())], numerics.fine.starts(segments))[0]
    assert not unsure(shooting, fit).any()
    exact, predicted = shooting.predicted(fit), iter(range(2))

    def fails(*_) -> np.ndarray:
        told = exact.copy()
        told[1] = np.nan  # by both
        if next(predicted) == 0:
            told[2] = np.nan
        return told

    monkeypatch.setattr(type(shooting), "predicted", fails)
    assert np.flatnonzero(unsure(shooting, fit)).tolist() == [2]
