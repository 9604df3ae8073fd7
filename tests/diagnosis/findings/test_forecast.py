from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.findings import forecast
from torch_activegp.diagnosis.findings.forecast import PAD, SEEN, STEP, compare, free_run, one_step
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import Segments, cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine


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
        starts, chi2 = followed(*arguments)
        return (starts + 0.3, chi2 * 2.0) if len(seen) == 1 and lost else (starts, chi2)

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


@pytest.mark.parametrize(("damping", "substeps"), [(0.1, 2), (1.0, 8), (4.0, 40)])
def test_initial_states_are_fitted_in_longer_steps_where_these_do(damping: float, substeps: int, monkeypatch) -> None:
    """Runge-Kutta of a stiff joint diverges in them: in 5 ms, and in 1.25 ms; there the engine itself fits."""
    xml = f"""<mujoco><option timestep="0.00025" integrator="RK4"/><worldbody><body>
    <joint name="x" damping="{damping}"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/>
    </body></worldbody>
    <actuator><motor name="m" joint="x"/></actuator></mujoco>"""
    model, rng = mujoco.MjModel.from_xml_string(xml), np.random.default_rng(0)
    data, positions, time = mujoco.MjData(model), [], np.arange(401) / 100
    control = damping * np.sin(7.0 * time)
    for force in control:
        positions.append(data.qpos[0])
        data.ctrl[:] = force
        mujoco.mj_step(model, data, 40)
    columns = {"time": time, "qpos.x": np.array(positions) + 1e-3 * rng.normal(size=401), "ctrl.m": control}
    machine = make_machine(model, [recording := Recording.from_columns("run", columns)], [recording])
    engine, noise = Engine(machine.model, machine.channels, 40, 1), NoiseModel.white(np.array([1e-3]))
    used, fit = set(), Shooting.fit
    monkeypatch.setattr(Shooting, "fit", lambda self, *a, **k: used.add(self.engine.substeps) or fit(self, *a, **k))
    overall, _ = compare({"before": (engine, NOMINAL)}, machine.fit, ["x"], noise)
    for kind in ("one_step", "free_run"):
        assert overall[kind]["before"] < 1.3 * overall[kind]["noise"]
    assert max(used) == substeps


def test_steps_that_misled_about_a_model_are_not_tried_with_it_again(bench, truth, monkeypatch) -> None:
    fine = Engine(bench.machine.model, bench.engine.channels, 8, 1, int(mujoco.mjtIntegrator.mjINT_RK4))
    begin = forecast._Beginnings(fine, bench.shooting.noise, [NOMINAL, truth], 0.005)
    whole = cut(bench.machine.holdout, 1e9, 0.0)
    asked: list[tuple[int, int]] = []
    fit = Shooting.fit
    monkeypatch.setattr(
        Shooting,
        "fit",
        lambda self, sets, *a, **k: asked.append((self.engine.substeps, len(sets))) or fit(self, sets, *a, **k),
    )
    monkeypatch.setattr(
        forecast, "_agrees", lambda _, fits: np.array([bool(one.effects) for one in fits])
    )  # the nominal is misled
    first = begin.fit(whole, fine.starts(whole))
    assert asked == [(1, 2), (4, 1), (8, 1)]
    assert first.shape == (2, whole.size, 2)
    asked.clear()
    again = begin.fit(whole, first)
    assert asked == [(1, 1), (8, 1)]
    np.testing.assert_allclose(again[0], first[0], atol=1e-3)
    asked.clear()
    begin.of(np.array([0])).fit(whole, fine.starts(whole))
    assert asked == [(8, 1)]


def test_only_steps_of_runge_kutta_are_made_longer(bench, clean) -> None:
    model, channels = bench.machine.model, bench.engine.channels
    fine = Engine(model, channels, 8, 1, int(mujoco.mjtIntegrator.mjINT_RK4))
    longer = fine.in_longer_steps(0.00125, 0.005)
    assert (longer.substeps, fine.substeps, longer.work) == (4, 8, 0.0)
    assert fine.in_longer_steps(0.0001, 0.005) is fine
    other = Engine(model, channels, 8, 1, int(mujoco.mjtIntegrator.mjINT_EULER))
    assert other.in_longer_steps(0.00125, 0.005) is other


@pytest.mark.parametrize("lost", [False, True])
def test_a_first_speed_that_was_smoothed_wrongly_is_not_the_guess(bench, truth, lost: bool) -> None:
    """By a coarse clock the smoothed recording begins at any speed: a line through the first recorded rows is tried."""
    run, whole = bench.machine.holdout[0], cut([bench.machine.holdout[0]], 1e9, PAD)
    begin = forecast._Beginnings(bench.engine, bench.shooting.noise, [NOMINAL, truth], 0.01)
    recorded, position = np.ones(len(run), dtype=bool), run.position.copy()
    if lost:  # rows of which nothing is known are on no line
        recorded[1:3], position[1:3] = False, position[1:3] + 100.0
    wrong = dataclasses.replace(run, position=position, recorded=recorded, velocity=run.velocity + 300.0)
    right = bench.engine.starts(whole)
    found = begin.guess(cut([wrong], 1e9, PAD))
    assert found.shape == (2, 1, 2)
    after = np.arange(len(run)) >= 5  # which a forecast of them must not see
    unseen = dataclasses.replace(wrong, position=np.where(after[:, None], 50.0, position))
    head = dataclasses.replace(cut([unseen], 1e9, PAD), counts=~after[None])
    along = forecast._along_lines(bench.engine, head, bench.engine.starts(head))
    np.testing.assert_allclose(along[0], right[0], atol=0.5)
    np.testing.assert_allclose(found[..., 1], right[0, 1], atol=0.5)
    np.testing.assert_allclose(found[..., 0], right[0, 0], atol=0.05)
    shooting = Shooting(bench.engine, whole, bench.shooting.noise)
    both = [forecast._chi2(shooting, [NOMINAL, truth], some) for some in (begin.guess(whole), np.stack([right] * 2))]
    assert (both[0] <= both[1]).all()


def test_forecasts_begin_with_that_guess(bench, truth, monkeypatch) -> None:
    """Without a fit they end where they began."""

    def begun(self: forecast._Beginnings, _: Segments, starts: np.ndarray) -> np.ndarray:
        return np.broadcast_to(starts, (len(self.candidates), *starts.shape[-2:])).copy()

    monkeypatch.setattr(forecast._Beginnings, "fit", begun)
    run, noise = bench.machine.holdout[0], bench.shooting.noise
    wrong = dataclasses.replace(run, velocity=run.velocity + 300.0)
    assert np.abs(one_step(bench.engine, [truth], [wrong], noise)[0][0]).max() < 1.0
    ((positions, _),) = free_run(bench.engine, [truth], [wrong], noise)[0]
    assert np.abs(positions - run.position).max() < 1.0
