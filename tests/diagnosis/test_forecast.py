from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.engine import NOMINAL, Candidate
from torch_activegp.diagnosis.forecast import STEP, compare, free_run, one_step
from torch_activegp.diagnosis.segments import cut


@pytest.fixture(scope="module")
def truth(bench) -> Candidate:
    return Candidate((bench.effect("viscous_friction"),), (np.array([bench.viscous]),))


def test_the_true_model_is_wrong_by_the_noise_alone(bench, truth) -> None:
    run = bench.machine.holdout[0]
    assert one_step(bench.engine, truth, run).std() < 4 * bench.noise
    ((positions, start),) = free_run(bench.engine, [truth], [run], bench.shooting.noise)[0]
    assert positions.shape == run.position.shape
    assert (positions - run.position).std() == pytest.approx(bench.noise, rel=0.2)
    assert start[0] == pytest.approx(run.smooth[0, 0], abs=5 * bench.noise)


def test_one_step_goes_as_far_as_it_says(bench, make_plain_run) -> None:
    """Against a pendulum at rest, a recording that moves away shows the distance of one step as its error."""
    run = bench.machine.holdout[0]
    moving = make_plain_run(0.5 * np.arange(201) / 100)
    rest = dataclasses.replace(moving, velocity=np.zeros((201, 1)), smooth=np.zeros((201, 1)))
    errors = one_step(bench.engine, NOMINAL, rest)
    starts = np.arange(0, 200, round(STEP * 100)) * 0.5 / 100
    np.testing.assert_allclose(errors[:, 0], starts + 0.5 * STEP, atol=1e-9)
    assert len(one_step(bench.engine, NOMINAL, run)) == 20


def test_a_last_step_that_is_shorter_ends_with_the_run(bench, make_plain_run) -> None:
    run = make_plain_run(np.zeros(205))
    whole = cut([run], 1e9, 0.0)
    states = bench.engine.trajectories(whole, np.array([[1.0, 0.0]]), NOMINAL)[0]
    own = dataclasses.replace(run, position=states[:, :1], smooth=states[:, :1], velocity=states[:, 1:])
    assert len(set(cut([own], STEP, 0.0).counts.sum(axis=1))) > 1
    np.testing.assert_allclose(one_step(bench.engine, NOMINAL, own), 0.0, atol=1e-9)


def test_compare_gives_errors_in_units_of_the_motion_and_the_traces_behind_them(bench, truth) -> None:
    models = {"before": (bench.engine, NOMINAL), "after": (bench.engine, truth)}
    run = bench.machine.holdout[0]
    overall, traces = compare(models, [run], ["hip"], bench.shooting.noise)
    (entry,), (trace,) = overall["runs"], traces
    assert entry["channel"] == trace["channel"] == "qpos.hip"
    assert trace["unit"] == "rad"
    spread = run.position.std()
    for name in models:
        far = np.sqrt(np.mean((np.array(trace[name]) - trace["measured"]) ** 2)) / spread
        assert overall["free_run"][name] == pytest.approx(far, rel=1e-3)
    assert overall["free_run"]["noise"] == pytest.approx(bench.noise / spread)
    assert overall["free_run"]["after"] < 0.2 * overall["free_run"]["before"]
    assert overall["one_step"]["after"] < overall["one_step"]["before"]
    assert len(trace["start_after"]) == 2


def test_a_model_that_fails_gets_a_huge_error_instead_of_nan(bench) -> None:
    wild = Candidate((bench.effect("linear_spring"),), (np.array([-1e9]),))
    overall, _ = compare({"before": (bench.engine, wild)}, bench.machine.holdout, ["hip"], bench.shooting.noise)
    assert overall["free_run"]["before"] > 1e3


@pytest.mark.parametrize(("name", "value"), [("sensor_delay", 0.03), ("sensor_bias", 0.2), ("sensor_gain", 0.3)])
def test_one_step_begins_where_the_machine_was_and_not_where_a_wrong_sensor_saw_it(bench, truth, name, value) -> None:
    """The same motion, read by a sensor with an effect: behind that effect the model is as right as before."""
    run = bench.machine.holdout[0]
    effect, values = bench.effect(name, "sensor:hip"), np.array([value])
    read = {
        "sensor_delay": np.interp(run.time - value, run.time, run.smooth[:, 0]),
        "sensor_bias": run.smooth[:, 0] + value,
        "sensor_gain": run.smooth[:, 0] * (1.0 + value),
    }[name][:, None]
    seen = dataclasses.replace(run, position=read, smooth=read, velocity=np.gradient(read, run.time, axis=0))
    behind = Candidate((*truth.effects, effect), (*truth.values, values))
    errors = one_step(bench.engine, behind, seen)[1:-1]
    unaware = one_step(bench.engine, truth, seen)[1:-1]
    assert np.abs(errors).max() < 30 * bench.noise
    assert (unaware**2).mean() > 4 * (errors**2).mean()
