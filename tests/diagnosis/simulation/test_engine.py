from __future__ import annotations

import copy
import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut, halve
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine, substeps_for
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.errors import ConfigurationError


def by_hand(bench, s: int, damping: float = 0.0, push: float = 0.0) -> np.ndarray:
    """Positions of one segment by plain MuJoCo."""
    model = mujoco.MjModel.from_xml_string(bench.xml)
    model.dof_damping[0] = damping
    data = mujoco.MjData(model)
    data.qpos[0], data.qvel[0] = bench.nominal.starts[s]
    data.qfrc_applied[0] = push
    seen = [data.qpos[0]]
    for u in bench.segments.take("control")[s]:
        data.ctrl[:] = u
        mujoco.mj_step(model, data, 2)
        seen.append(data.qpos[0])
    return np.array(seen)


def test_candidates_side_by_side_equal_plain_mujoco(bench) -> None:
    force = np.full((bench.segments.size, bench.segments.intervals, 1), 0.1)
    damped = Candidate((bench.effect("viscous_friction"),), (np.array([0.05]),))
    candidates = [NOMINAL, damped, Candidate(force=force)]
    starts = np.repeat(bench.nominal.starts[None], 3, axis=0)
    read = bench.engine.predict(bench.segments, starts, candidates)
    assert read.shape == (3, bench.segments.size, bench.segments.intervals + 1, 1)
    for s in (0, 5):
        np.testing.assert_allclose(read[0, s, :, 0], by_hand(bench, s), atol=1e-12)
        np.testing.assert_allclose(read[2, s, :, 0], by_hand(bench, s, push=0.1), atol=1e-12)
        moved = np.abs(read[1, s, :, 0] - read[0, s, :, 0]).max()
        assert np.abs(read[1, s, :, 0] - by_hand(bench, s, damping=0.05)).max() < 0.02 * moved


def test_segments_are_simulated_without_mujocos_timers(bench) -> None:
    read: list[float] = []
    mujoco.set_mjcb_time(lambda: float(read.append(0.0) or len(read)))
    try:
        bench.engine.predict(bench.segments, bench.nominal.starts[None], [NOMINAL])
    finally:
        mujoco.set_mjcb_time(None)
    assert not read


def test_an_edited_model_is_put_back(bench) -> None:
    before = bench.predict(NOMINAL)
    loaded = Candidate((bench.effect("payload_mass", "body:rod"),), (np.array([0.5]),))
    assert np.abs(bench.predict(loaded) - before).max() > 1e-3
    np.testing.assert_array_equal(bench.predict(NOMINAL), before)


def test_an_edited_model_is_put_back_whatever_other_batch_ran_between(bench) -> None:
    loaded = Candidate((bench.effect("payload_mass", "body:rod"),), (np.array([0.5]),))
    rubbed = Candidate((bench.effect("stribeck_friction"),), (np.array([0.1, 0.1, 0.2]),))  # acts in every step
    both = Candidate((*loaded.effects, *rubbed.effects), (*loaded.values, *rubbed.values))
    few = bench.segments.pick(np.array([0, 1]))

    def run(engine: Engine, candidate: Candidate) -> np.ndarray:
        count = 20  # simulations of either kind have batches of the same size
        starts = np.repeat(bench.nominal.starts[None, :2], count, axis=0)
        return engine.predict(few, starts, [candidate] * count)

    fresh, used = (Engine(mujoco.MjModel.from_xml_string(bench.xml), bench.engine.channels, 2, 1) for _ in range(2))
    wanted = run(fresh, rubbed)
    for candidate in (both, NOMINAL):
        run(used, candidate)
    np.testing.assert_array_equal(run(used, rubbed), wanted)


def test_equal_inputs_give_equal_bits_whatever_ran_before(bench) -> None:
    again = Engine(mujoco.MjModel.from_xml_string(bench.xml), bench.engine.channels, 2, 1)
    fresh = again.predict(bench.segments, bench.nominal.starts[None], [NOMINAL])[0]
    np.testing.assert_array_equal(bench.predict(NOMINAL), fresh)


def test_many_candidates_are_simulated_in_several_calls(bench, monkeypatch) -> None:
    candidates = [Candidate((bench.effect("viscous_friction"),), (np.array([c]),)) for c in (0.0, 0.1, 0.2)]
    starts = np.repeat(bench.nominal.starts[None], 3, axis=0)
    at_once = bench.engine.predict(bench.segments, starts, candidates)
    monkeypatch.setattr("torch_activegp.diagnosis.simulation.engine._MAX_ROWS", bench.segments.size)
    np.testing.assert_array_equal(bench.engine.predict(bench.segments, starts, candidates), at_once)


def test_a_failed_simulation_is_nan_and_leaves_the_others_alone(bench) -> None:
    starts = np.repeat(bench.nominal.starts[None], 2, axis=0)
    starts[1, 2, 1] = np.inf
    read = bench.engine.predict(bench.segments, starts, [NOMINAL, NOMINAL])
    assert np.isnan(read[1, 2, 1:]).all()
    others = np.arange(bench.segments.size) != 2
    np.testing.assert_array_equal(read[1, others], read[0, others])


def test_starts_are_the_smoothed_recordings(bench) -> None:
    starts = bench.engine.starts(bench.segments)
    assert np.abs(starts - bench.nominal.starts).max(axis=0) == pytest.approx([0.0, 0.0], abs=0.2)
    run = bench.segments.runs[1]
    row = bench.segments.first[-1]
    np.testing.assert_array_equal(starts[-1], [run.smooth[row, 0], run.velocity[row, 0]])


def test_the_integrator_can_be_chosen_and_the_model_is_copied(bench, model) -> None:
    implicit = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    engine = Engine(model, bench.engine.channels, 1, 1, implicit)
    assert engine.model.opt.integrator == implicit
    assert model.opt.integrator == int(mujoco.mjtIntegrator.mjINT_RK4)


def test_substeps_are_at_least_one(bench, model) -> None:
    assert substeps_for(model, bench.machine.fit) == 2
    model = mujoco.MjModel.from_xml_string(bench.xml.replace("0.005", "0.05"))
    assert substeps_for(model, bench.machine.fit) == 1


def test_a_model_that_cannot_run_in_batches_is_refused(bench, monkeypatch) -> None:
    def refuse(*_: object) -> None:
        raise ValueError("no plugins")

    monkeypatch.setattr("mujoco.batch.Batch", refuse)
    engine = Engine(mujoco.MjModel.from_xml_string(bench.xml), bench.engine.channels, 2, 1)
    with pytest.raises(ConfigurationError, match=r"in batches: no plugins\. Turn that feature off"):
        engine.predict(bench.segments, bench.nominal.starts[None], [NOMINAL])


def test_a_stride_of_two_rows_agrees_with_every_row(bench) -> None:
    """Runge-Kutta over two rows with the mean control, and cubic Hermite between: below the noise."""
    rk4 = int(mujoco.mjtIntegrator.mjINT_RK4)
    model = mujoco.MjModel.from_xml_string(bench.xml)
    one, two = (Engine(model, bench.engine.channels, 1, 1, rk4, stride) for stride in (1, 2))
    near, far = (e.trajectories(bench.segments, bench.nominal.starts, NOMINAL) for e in (one, two))
    assert np.abs(near[..., 0] - far[..., 0]).max() < 0.4 * bench.noise
    np.testing.assert_allclose(near[..., 1], far[..., 1], atol=0.05)


def test_runs_hold_what_the_limits_of_the_actuators_let_pass(bench, record) -> None:
    text = bench.xml.replace(
        'joint="hip"/></actuator>', 'joint="hip" ctrllimited="true" ctrlrange="-0.3 0.2"/></actuator>'
    )
    machine = make_machine(mujoco.MjModel.from_xml_string(text), [record()], [record(seed=1)])
    assert machine.fit[0].control.max() == 0.2
    assert machine.fit[0].control.min() == -0.3


@pytest.mark.parametrize("stride", [1, 2, 3])
def test_a_leapfrog_is_of_second_order(clean, stride) -> None:
    """Once the initial states are fitted, the error to a fine simulation is a small part of plain Euler's."""
    model, channels = clean.machine.model, clean.engine.channels
    fine = Engine(model, channels, 10, 1).predict(clean.segments, clean.nominal.starts[None], [NOMINAL])[0]
    segments = dataclasses.replace(clean.segments, position=fine)
    errors = {}
    for late in (False, True):
        integrator = None if late else int(mujoco.mjtIntegrator.mjINT_EULER)
        engine = Engine(model, channels, 1, 1, integrator, stride, late=late)
        shooting = dataclasses.replace(clean.shooting, engine=engine, segments=segments)
        errors[late] = shooting.fit([((), ())], clean.nominal.starts)[0].chi2
    assert errors[True] < 0.05 * errors[False]


def test_a_leapfrog_takes_no_integrator(clean) -> None:
    with pytest.raises(ConfigurationError, match="of its own"):
        Engine(clean.machine.model, clean.engine.channels, 1, 1, 0, late=True)


def test_what_an_effect_edits_leaves_no_trace_in_a_leapfrog(clean) -> None:
    """Constants that follow from an edit follow from the machine's inertia, not from that of the scheme."""
    text = clean.xml.replace('name="hip"', 'name="hip" damping="40" frictionloss="0.6"', 1)
    late = Engine(mujoco.MjModel.from_xml_string(text), clean.engine.channels, 1, 1, late=True)
    where = (clean.segments, clean.nominal.starts[None])
    before = late.predict(*where, [NOMINAL])
    load = clean.effect("payload_mass", "body:rod")
    late.predict(*where, [Candidate((load,), (load.seeds[0],))])
    np.testing.assert_array_equal(late.predict(*where, [NOMINAL]), before)


def test_a_leapfrog_is_runge_kutta_to_mujoco_alone(clean) -> None:
    model, channels, where = clean.machine.model, clean.engine.channels, (clean.segments, clean.nominal.starts[None])
    late = Engine(model, channels, 3, 1, late=True)
    expected = Engine(model, channels, 3, 1, int(mujoco.mjtIntegrator.mjINT_RK4)).predict(*where, [NOMINAL])
    np.testing.assert_array_equal(late.without_leapfrog().predict(*where, [NOMINAL]), expected)
    assert not np.array_equal(late.predict(*where, [NOMINAL]), expected)
    assert clean.engine.without_leapfrog() is clean.engine


def test_work_is_counted_in_time_steps(bench) -> None:
    rows = bench.segments.lengths.sum()
    for integrator, times in ((0, 1), (int(mujoco.mjtIntegrator.mjINT_RK4), 4)):
        engine = Engine(bench.engine.model, bench.engine.channels, 3, 1, integrator)
        engine.predict(bench.segments, bench.nominal.starts[None], [NOMINAL])
        assert engine.work == pytest.approx(rows * 3 * times, rel=0.02)


def test_runs_of_other_rates_do_not_change_how_a_leapfrog_damps(clean) -> None:
    """Half a time step of damping is taken out of each simulation by its own time step."""
    machine = clean.integrated("implicitfast", 0.005, joint='damping="0.6"')
    engine = Engine(machine.model, machine.channels, substeps=1, late=True)
    fast = clean.segments
    slow = dataclasses.replace(fast, dt=2.0 * fast.dt)
    names = ("run", "first", "position", "counts", "dt", "scored")
    both = dataclasses.replace(
        fast, **{name: np.concatenate([getattr(fast, name), getattr(slow, name)]) for name in names}
    )
    starts = clean.nominal.starts
    together = engine.predict(both, np.concatenate([starts, starts])[None], [NOMINAL])[0]
    for part, alone in ((together[: fast.size], fast), (together[fast.size :], slow)):
        np.testing.assert_allclose(part, engine.predict(alone, starts[None], [NOMINAL])[0], rtol=0, atol=1e-12)


def test_a_force_that_is_held_over_steps_of_runge_kutta_is_that_of_their_middle(bench) -> None:
    """So halving the steps leaves a quarter of the error, and not a half."""
    wavy, memory = bench.effect("cogging"), bench.effect("hysteresis")
    candidates = [
        Candidate((wavy,), (np.array([0.3, 0.2, *wavy.seeds[0][2:]]),)),
        Candidate((memory,), (np.array([3.0, 0.2]),)),
    ]
    starts, read = np.repeat(bench.nominal.starts[None], 2, axis=0), []
    for substeps in (1, 2, 32):
        engine = Engine(bench.machine.model, bench.engine.channels, substeps, 1)
        read.append(engine.predict(bench.segments, starts, candidates))
    errors = [np.abs(some - read[-1]).max(axis=(1, 2, 3)) for some in read[:2]]
    assert (errors[0] > 2.5 * errors[1]).all()


@pytest.mark.parametrize("integrator", [None, int(mujoco.mjtIntegrator.mjINT_EULER)])
def test_only_steps_of_runge_kutta_take_a_force_in_their_middle(bench, monkeypatch, integrator) -> None:
    seen: list[float] = []
    wavy = bench.effect("cogging")
    monkeypatch.setattr(type(wavy), "before_step", lambda self, step, rows, values, memory: seen.append(step.middle))
    engine = Engine(bench.machine.model, bench.engine.channels, 1, 1, integrator)
    engine.predict(bench.segments, bench.nominal.starts[None], [Candidate((wavy,), (wavy.seeds[0],))])
    assert set(seen) == {0.5 if integrator is None else 0.0}  # the model's own is Runge-Kutta


def test_a_rotor_is_carried_along_the_recording_behind_the_control_of_its_candidate(bench, monkeypatch) -> None:
    play, gain = bench.effect("backlash"), bench.effect("actuator_gain", "actuator:drive")
    values = np.array([0.3])
    seen: list[np.ndarray] = []
    kind, memory = type(play), type(play).memory

    def keep(self, *args):
        begun = memory(self, *args)
        seen.append(begun.copy())
        return begun

    monkeypatch.setattr(kind, "memory", keep)
    other = Candidate((play, gain), (values, np.array([-2.0])))  # the motor pushes the other way
    starts = np.repeat(bench.nominal.starts[None], 2, axis=0)
    bench.engine.predict(bench.segments, starts, [Candidate((play,), (values,)), other])
    (found,) = seen
    size, later = bench.segments.size, bench.segments.first > 30
    assert np.isfinite(found[:size, 3][later]).all()
    assert not found[:size, 1:4][bench.segments.first == 0].any()  # in the middle
    assert not np.allclose(found[:size, 1][later], found[size:, 1][later])


def test_only_steps_of_runge_kutta_are_made_longer(bench) -> None:
    model, channels = bench.machine.model, bench.engine.channels
    fine = Engine(model, channels, 8, 1, int(mujoco.mjtIntegrator.mjINT_RK4))
    longer = fine.in_longer_steps(0.00125, 0.005)
    assert (longer.substeps, fine.substeps, longer.work) == (4, 8, 0.0)
    assert fine.in_longer_steps(0.0001, 0.005) is fine
    other = Engine(model, channels, 8, 1, int(mujoco.mjtIntegrator.mjINT_EULER))
    assert other.in_longer_steps(0.00125, 0.005) is other


def test_a_gap_is_the_same_in_longer_steps_of_runge_kutta(bench, monkeypatch) -> None:
    """Half a step earlier, impacts are no later than they are: that halves the error."""
    candidate = Candidate((bench.effect("backlash"),), (np.array([0.2]),))

    def read(substeps: int) -> np.ndarray:
        engine = Engine(bench.machine.model, bench.engine.channels, substeps, 1)
        return engine.predict(bench.segments, bench.nominal.starts[None], [candidate])

    wanted = read(64)
    found = np.sqrt(np.nanmean((read(2) - wanted) ** 2))
    step = dataclasses.replace
    monkeypatch.setattr("torch_activegp.physics.backlash.Backlash.before_step", _as_if_late(step))
    assert found < 0.7 * np.sqrt(np.nanmean((read(2) - wanted) ** 2))


@pytest.mark.parametrize("late", [False, True])
def test_without_a_gap_it_does_not_matter_whose_the_damping_is(bench, late: bool) -> None:
    """By a leapfrog too, which takes half a step of damping off the inertia."""
    model = copy.copy(bench.machine.model)
    model.opt.integrator, model.dof_damping[:] = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST), 0.1
    machine = dataclasses.replace(bench.machine, model=model)
    forms = {e.variant: e for e in effects_for(model, machine.channels, machine.fit) if e.name == "backlash"}
    engine = Engine(model, bench.engine.channels, 1, 1, late=late)

    def read(effect) -> np.ndarray:
        candidate = Candidate((effect,), (np.zeros(1),))
        return engine.predict(bench.segments, bench.nominal.starts[None], [candidate])

    load, rotor = read(forms[""]), read(forms["damped rotor"])
    assert np.nanstd(load) > 0.1
    assert np.nanstd(rotor - load) < 1e-5


def _as_if_late(replace):
    """Backlash that does not know of the middle of a step."""
    from torch_activegp.physics.backlash import Backlash

    known = Backlash.before_step
    return lambda self, step, *args: known(self, replace(step, middle=0.0), *args)


def test_a_segment_is_simulated_alike_whatever_is_simulated_beside_it(bench) -> None:
    """Dry friction is as soft as the time step is long, and runs may be of different rates."""
    slow = dataclasses.replace(bench.machine.fit[1], time=4.0 * bench.machine.fit[1].time)
    segments = cut([bench.machine.fit[0], slow], 0.5, 0.0)
    candidate = Candidate((bench.effect("coulomb_friction"),), (np.array([1.5]),))
    starts = bench.engine.starts(segments)
    together = bench.engine.trajectories(segments, starts, candidate)
    alone = segments.run == 0
    np.testing.assert_array_equal(
        bench.engine.trajectories(segments.pick(alone), starts[alone], candidate), together[alone]
    )


def test_short_segments_do_not_wait_for_long_ones(bench) -> None:
    """And push by push each gets its own forces; what follows its end is held."""
    uneven = halve(cut(bench.machine.fit, 2.0, 0.0), np.array([True, False]))
    segments = uneven.pick(np.tile(np.arange(uneven.size), 20))
    push = np.random.default_rng(0).normal(size=(segments.size, segments.intervals, 1))
    candidates, starts = [Candidate(force=push), NOMINAL], bench.engine.starts(segments)
    engine = Engine(bench.engine.model, bench.engine.channels, 1, 1)
    together = engine.predict(segments, np.stack([starts, starts]), candidates)
    rows = segments.lengths
    assert len(set(rows)) > 1
    assert rows.sum() < 0.7 * segments.size * segments.intervals
    assert engine.work == 2 * engine.steps_in(segments) == 2 * 4 * rows.sum()  # Runge-Kutta's
    for s in (0, 1, segments.size - 1):
        alone = segments.pick(np.array([s]))
        (mine,) = engine.predict(alone, starts[None, [s]], [candidates[0].pick(np.array([s]))])[0]
        np.testing.assert_array_equal(together[0, s], mine)
        assert (together[:, s, rows[s] :] == together[:, s, [rows[s]]]).all()
