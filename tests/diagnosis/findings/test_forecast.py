from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings import forecast
from torch_activegp.diagnosis.findings.beginnings import Beginnings
from torch_activegp.diagnosis.findings.forecast import compare, free_run, one_step, without_model
from torch_activegp.diagnosis.inputs.held_out import PAD, SEEN, STEP
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate


@pytest.fixture(scope="module")
def truth(bench) -> Candidate:
    return Candidate((bench.effect("viscous_friction"),), (np.array([bench.viscous]),))


def test_the_true_model_is_wrong_by_the_noise_alone(bench, truth) -> None:
    run, noise = bench.machine.holdout[0], bench.shooting.noise
    nominal, right = (errors for (errors,) in one_step(bench.engine, [NOMINAL, truth], [run], noise))
    assert right.std() == pytest.approx(bench.noise, rel=0.35)
    assert nominal.std() > 3 * bench.noise
    ((positions, start),) = free_run(bench.engine, [truth], [run], noise)[0]
    assert positions.shape == run.position.shape
    assert (positions - run.position).std() == pytest.approx(bench.noise, rel=0.2)
    assert start[0] == pytest.approx(run.smooth[0, 0], abs=5 * bench.noise)


def test_one_step_goes_as_far_as_it_says(bench, make_plain_run) -> None:
    """What stands still while it is seen, and is gone one step later, shows how far it went as the error."""
    rest = np.zeros(201)
    rest[51:] = 0.5
    errors = one_step(bench.engine, [NOMINAL], [make_plain_run(rest)], bench.shooting.noise)[0][0][:, 0]
    assert len(errors) == 1 + (200 - 60) // 50
    np.testing.assert_allclose(errors[0], 0.5, atol=1e-6)
    assert np.abs(errors[2:]).max() > 0.01  # a pendulum does not stay at half a radian


def test_what_comes_after_is_not_seen(bench, truth) -> None:
    run, noise = bench.machine.holdout[0], bench.shooting.noise
    ahead = round((SEEN + STEP + 0.1) / run.dt[0])
    moved = run.position.copy()
    moved[ahead] += 1.0
    one, other = (
        one_step(bench.engine, [truth], [some], noise)[0][0] for some in (run, dataclasses.replace(run, position=moved))
    )
    assert other[0] - one[0] == pytest.approx(1.0, abs=1e-9)


def test_a_run_too_short_to_see_much_of_is_forecast_from_what_there_is(bench, truth) -> None:
    run = bench.machine.holdout[0]
    short = dataclasses.replace(
        run,
        **{name: getattr(run, name)[:16] for name in ("time", "position", "smooth", "velocity", "recorded")},
        **{name: getattr(run, name)[:15] for name in ("control", "force")},
    )
    errors = one_step(bench.engine, [truth], [short], bench.shooting.noise)[0][0]
    assert errors.shape == (1, 1)
    gone = dataclasses.replace(short, recorded=np.arange(16) < 10)
    assert one_step(bench.engine, [truth], [gone], bench.shooting.noise)[0][0].shape == (1, 1)


def test_compare_gives_errors_in_units_of_the_motion_and_the_traces_behind_them(bench, truth) -> None:
    models = {"before": (bench.engine, NOMINAL), "after": (bench.engine, truth)}
    run = bench.machine.holdout[0]
    overall, traces = compare(models, [run], ["hip"], bench.shooting.noise)
    (entry,), (trace,) = overall["runs"], traces
    assert entry["channel"] == trace["channel"] == "qpos.hip"
    assert trace["unit"] == "rad"
    spread = run.position.std()
    scored = slice(round(PAD / np.median(run.dt)), None)
    for name in models:
        far = np.sqrt(np.mean((np.array(trace[name]) - trace["measured"])[scored] ** 2)) / spread
        assert overall["free_run"][name] == pytest.approx(far, rel=1e-3)
    assert overall["free_run"]["noise"] == pytest.approx(bench.noise / spread)
    assert overall["free_run"]["after"] < 0.2 * overall["free_run"]["before"]
    assert overall["one_step"]["after"] < overall["one_step"]["before"]
    assert len(trace["start_after"]) == 2


def test_a_model_that_fails_gets_a_huge_error_instead_of_nan(bench) -> None:
    wild = Candidate((bench.effect("linear_spring"),), (np.array([-1e9]),))
    overall, _ = compare({"before": (bench.engine, wild)}, bench.machine.holdout, ["hip"], bench.shooting.noise)
    assert overall["free_run"]["before"] == overall["runs"][0]["free_run"]["before"] == 1e9


def test_a_model_that_is_taken_out_leaves_what_the_others_say(bench, truth) -> None:
    run, noise = bench.machine.holdout[:1], bench.shooting.noise
    alone, (without,) = compare({"before": (bench.engine, NOMINAL)}, run, ["hip"], noise)
    overall, (trace,) = compare({"before": (bench.engine, NOMINAL), "gp": (bench.engine, truth)}, run, ["hip"], noise)
    assert trace["gp"] is not None
    assert without_model("gp", overall, [trace]) == (alone, [without])
    assert "gp" in overall["one_step"]


def test_what_the_first_rows_remember_of_the_time_before_does_not_count(bench, truth) -> None:
    """An encoder that was late when the recording began, for instance, as in the fits."""
    run = bench.machine.holdout[0]
    first = np.arange(len(run)) < round(PAD / np.median(run.dt))
    late = dataclasses.replace(run, position=run.position + 0.3 * first[:, None])
    one, other = (
        compare({"after": (bench.engine, truth)}, [some], ["hip"], bench.shooting.noise)[0] for some in (run, late)
    )
    spread = [some.position.std() for some in (run, late)]
    assert other["free_run"]["after"] * spread[1] == pytest.approx(one["free_run"]["after"] * spread[0])


@pytest.mark.parametrize("moves", [True, False])
def test_a_joint_that_stands_still_counts_in_its_noise_and_in_nothing_over_all(bench, moves: bool) -> None:
    """Unless nothing moves at all: a tenth of a thousandth of its spread is no measure of anything."""
    moving, noise = bench.machine.holdout[0], bench.noise
    rest = noise * np.random.default_rng(0).normal(size=(len(moving), 1))
    still = dataclasses.replace(
        moving, position=rest, smooth=0 * rest, velocity=0 * rest, control=0 * moving.control, label="still"
    )
    runs = [moving, still] if moves else [still]
    overall, _ = compare({"before": (bench.engine, NOMINAL)}, runs, ["hip"], bench.shooting.noise)
    entry = overall["runs"][-1]
    assert entry["free_run"]["noise"] == entry["one_step"]["noise"] == 1.0
    assert entry["free_run"]["before"] == pytest.approx(1.0, rel=0.2)
    assert overall["free_run"] == overall["runs"][0]["free_run"]


@pytest.mark.parametrize(("name", "value"), [("sensor_delay", 0.03), ("sensor_bias", 0.2), ("sensor_gain", 0.3)])
def test_one_step_begins_where_the_machine_was_and_not_where_a_wrong_sensor_saw_it(bench, truth, name, value) -> None:
    """The same motion, read by a sensor with an effect: behind that effect the model is as right as before."""

    def seen(run):
        read = {
            "sensor_delay": np.interp(run.time - value, run.time, run.smooth[:, 0]),
            "sensor_bias": run.smooth[:, 0] + value,
            "sensor_gain": run.smooth[:, 0] * (1.0 + value),
        }[name][:, None]
        return dataclasses.replace(run, position=read, smooth=read, velocity=np.gradient(read, run.time, axis=0))

    behind = Candidate((*truth.effects, bench.effect(name, "sensor:hip")), (*truth.values, np.array([value])))
    runs = [seen(run) for run in (*bench.machine.holdout, *bench.machine.fit)]
    both = one_step(bench.engine, [truth, behind], runs, bench.shooting.noise)
    unaware, errors = (np.concatenate(some) for some in both)
    assert np.abs(errors).max() < 10 * bench.noise
    assert (unaware**2).mean() > 4 * (errors**2).mean()


def test_a_model_that_is_another_one_too_is_simulated_once(bench) -> None:
    begun = bench.engine.work
    run, noise = bench.machine.holdout[:1], bench.shooting.noise
    alone, _ = compare({"before": (bench.engine, NOMINAL)}, run, ["hip"], noise)
    work = bench.engine.work - begun
    both, (trace,) = compare({"before": (bench.engine, NOMINAL), "after": (bench.engine, NOMINAL)}, run, ["hip"], noise)
    assert bench.engine.work - begun == 2.0 * work
    assert both["free_run"]["after"] == both["free_run"]["before"] == alone["free_run"]["before"]
    assert trace["after"] == trace["before"]


def test_a_model_that_does_not_follow_a_run_is_begun_from_longer_beginnings_too(bench, truth, monkeypatch) -> None:
    """And what follows it costs nothing more."""
    seen: list[list[float]] = []
    followed = forecast._followed

    def spy(*arguments):
        seen.append(arguments[-1])
        starts, paths = followed(*arguments)
        return (starts + 0.3, paths + 0.3) if len(seen) == 1 and lost else (starts, paths)

    monkeypatch.setattr(forecast, "_followed", spy)
    monkeypatch.setattr(forecast, "_FIRST", 0.5)
    lost = False
    assert len(free_run(bench.engine, [truth], bench.machine.holdout, bench.shooting.noise)) == len(seen) == 1
    seen.clear()
    plain = free_run(bench.engine, [NOMINAL], bench.machine.holdout, bench.shooting.noise)[0][0]
    assert seen == [[0.5], [1.0]]
    seen.clear()
    lost = True  # the first fit ended elsewhere
    other = free_run(bench.engine, [NOMINAL], bench.machine.holdout, bench.shooting.noise)[0][0]
    np.testing.assert_allclose(other[1], plain[1], atol=1e-3)


@pytest.fixture
def astray(bench, truth, monkeypatch):
    """Free runs of two equal models over two runs of different length, some of which were led astray."""
    followed, ended, tried = forecast._followed, forecast._ended, []
    long = bench.machine.holdout[0]
    runs = [long, dataclasses.replace(bench.machine.fit[0], label="other")]
    models = [truth, Candidate(truth.effects, truth.values)]

    def lead(by: np.ndarray) -> tuple[np.ndarray, list]:
        """By so much, ``(2, 2)``; what is left of each in units of the noise, and the models and runs tried again."""

        def led(begin, whole, lengths):
            starts, _ = followed(begin, whole, lengths)
            starts[..., 0] += by
            return starts, begin.engine.predict(whole, starts, begin.candidates)

        def spy(begin, whole, starts):
            tried.append((len(begin.candidates), [whole.runs[i].label for i in whole.run]))
            return ended(begin, whole, starts)

        tried.clear()
        monkeypatch.setattr(forecast, "_followed", led)
        monkeypatch.setattr(forecast, "_ended", spy)
        found = free_run(bench.engine, models, runs, bench.shooting.noise)
        off = [[np.std(run.position - path) for run, (path, _) in zip(runs, some, strict=True)] for some in found]
        return np.array(off) / bench.shooting.noise.scale[0], tried[1:]

    monkeypatch.setattr(forecast, "_FIRST", 1e3)  # no longer beginnings
    return lead


def test_a_model_that_does_not_follow_a_run_begins_where_the_one_that_does_begins(astray) -> None:
    """In each run another one; and what is followed is not tried again."""
    off, lent = astray(np.array([[0.0, 3.0], [3.0, 0.0]]))
    assert (off < 1.3).all()
    assert lent == [(2, ["kept", "other"])]
    off, lent = astray(np.array([[0.0, 3.0], [0.0, 0.0]]))
    assert (off < 1.3).all()
    assert lent == [(1, ["other"])]


def test_where_no_model_follows_none_lends_its_begin(astray) -> None:
    off, lent = astray(np.array([[3.0, 0.0], [2.9, 0.0]]))
    assert (off[:, 0] > 5.0).all()
    assert lent == []


def test_forecasts_begin_with_that_guess(bench, truth, monkeypatch) -> None:
    """Without a fit they end where they began."""

    def begun(self: Beginnings, _: Segments, starts: np.ndarray) -> np.ndarray:
        return np.broadcast_to(starts, (len(self.candidates), *starts.shape[-2:])).copy()

    monkeypatch.setattr(Beginnings, "fit", begun)
    run, noise = bench.machine.holdout[0], bench.shooting.noise
    wrong = dataclasses.replace(run, velocity=run.velocity + 300.0)
    assert np.abs(one_step(bench.engine, [truth], [wrong], noise)[0][0]).max() < 1.0
    ((positions, _),) = free_run(bench.engine, [truth], [wrong], noise)[0]
    assert np.abs(positions - run.position).max() < 1.0
