"""A joint that a rig moves, against the equations of what it carries."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.runs import Channels, Run, make_run
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.prescribed_motion import only_on

HELD = 'damping="2" frictionloss="3" stiffness="30" limited="true" range="-1 1"'


def prepared(
    double, integrator: str, step: float, shoulder: str = "", drive: float = 0.5
) -> tuple[Engine, Run, np.ndarray, np.ndarray]:
    """Engine, one run of a second, its true initial state, and the true angles of the elbow."""
    recording, columns = double.record(3, seconds=1.0, drive=drive), double.columns(3, seconds=1.0, drive=drive)
    model = double.model(step, integrator, shoulder)
    channels = Channels.of(model, [recording])
    q, v, _ = double.path(np.zeros(1), 3)
    start = np.array([q[0], columns["qpos.elbow"][0], v[0], columns["speed"][0]])
    engine = Engine(model, channels, round(0.01 / step), 1)
    return engine, make_run(recording, model, channels), start, columns["qpos.elbow"]


def test_what_the_joint_carries_follows_the_equations(double) -> None:
    """Whatever acts on the prescribed joint itself, and whatever its state is said to be in the beginning."""
    engine, run, start, elbow = prepared(double, "RK4", 0.005, HELD)
    for shoulder in (start[0], 0.7):
        begin = np.array([shoulder, start[1], start[2], start[3]])
        read = engine.predict(cut([run], 9.0, 0.0), begin[None, None], [NOMINAL])
        assert read.shape == (1, 1, 101, 1)
        assert np.abs(read[0, 0, :, 0] - elbow).max() < 2e-5


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "implicit", "RK4"])
def test_every_integrator_agrees_from_its_own_best_start(double, integrator: str) -> None:
    """What a semi-implicit step calls a velocity is that of half a step before; the rest must be right."""
    engine, run, start, _ = prepared(double, integrator, 0.002, drive=0.0)
    shooting = Shooting(engine, cut([run], 9.0, 0.0), NoiseModel.white(np.array([1e-5])))
    fit = shooting.fit([((), ())], start[None])[0]
    assert np.abs(1e-5 * shooting.residual_of(fit)).max() < 2e-5
    np.testing.assert_array_equal(fit.starts[0, [0, 2]], start[[0, 2]])


def test_the_joint_itself_is_where_it_was(double) -> None:
    engine, run, start, _ = prepared(double, "RK4", 0.005, HELD)
    states = engine.trajectories(cut([run], 0.2, 0.0), np.tile(start, (5, 1)), NOMINAL)
    q, v, _ = double.path(np.arange(101) / 100, 3)
    for s in range(5):
        np.testing.assert_allclose(states[s, 1:, 0], q[20 * s + 1 : 20 * s + 21], atol=1e-5)
        np.testing.assert_allclose(states[s, 1:-1, 2], v[20 * s + 1 : 20 * s + 20], atol=2e-3)


def test_rows_may_be_missing_uneven_or_many_in_a_step(double) -> None:
    recording, start = double.record(3, seconds=1.0), prepared(double, "RK4", 0.005)[2]
    rows = np.setdiff1d(np.arange(101), [20, 21, 60])
    kept = {name: recording[name].numpy()[rows] for name in recording.columns}
    model = double.model()
    some = recording.replace({name: recording[name][rows] for name in recording.columns})
    channels = Channels.of(model, [some])
    run = make_run(some, model, channels)
    assert len(run) == 101 and not run.recorded[20]
    for engine in (Engine(model, channels, 2, 1), Engine(model, channels, 1, 1, stride=2)):
        read = engine.predict(cut([run], 9.0, 0.0), start[None, None], [NOMINAL])
        assert np.abs(read[0, 0, rows, 0] - kept["qpos.elbow"]).max() < 5e-3 * engine.stride


def test_forces_and_edits_of_candidates_act_on_what_it_carries(double) -> None:
    """A weight that the rig carries alone is not felt; one on the lower arm is; and the model is put back."""
    engine, run, start, _ = prepared(double, "RK4", 0.005)
    segments = cut([run], 9.0, 0.0)
    push = np.zeros((1, 100, 2))
    push[..., 0] = 5.0
    twist = np.zeros((1, 100, 2))
    twist[..., 1] = 0.1
    starts = np.tile(start, (3, 1, 1))
    candidates = [NOMINAL, Candidate(force=push), Candidate(force=twist)]
    plain, pushed, twisted = engine.predict(segments, starts, candidates)
    np.testing.assert_array_equal(pushed, plain)
    assert np.abs(twisted - plain).max() > 0.01


def test_a_run_that_prescribes_nothing_leaves_the_joint_where_it_begins(double) -> None:
    engine, run, start, _ = prepared(double, "RK4", 0.005)
    still = dataclasses.replace(run, prescribed=None)
    states = engine.trajectories(cut([still], 9.0, 0.0), start[None], NOMINAL)[0]
    np.testing.assert_allclose(states[1:, 0], start[0], atol=1e-9)
    model = double.model()
    data = mujoco.MjData(model)
    model.dof_armature[0] = 1e6
    data.qpos[:], data.qvel[:] = start[:2], [0.0, start[3]]
    for u in run.control:
        data.ctrl[:] = u
        mujoco.mj_step(model, data, 2)
    assert states[-1, 1] == pytest.approx(data.qpos[1], abs=1e-5)


def test_shorter_runs_go_straight_on_and_do_no_harm(double) -> None:
    """Segments of unequal runs are as long as the longest one; what comes after the end of a run does not count."""
    model = double.model()
    recordings = [double.record(3, seconds=1.0), double.record(4, seconds=3.0)]
    channels = Channels.of(model, recordings)
    runs = [make_run(recording, model, channels) for recording in recordings]
    engine, whole = Engine(model, channels, 2, 1), cut(runs, 9.0, 0.0)
    states = engine.trajectories(whole, engine.starts(whole), NOMINAL)
    assert np.isfinite(states).all()
    q, v, _ = double.path(np.array([1.0]), 3)
    assert states[0, 200, 0] == pytest.approx(q[0] + v[0], abs=1e-2)


TABLE = """
<mujoco><option timestep="0.001" integrator="RK4"/><worldbody>
<body><joint name="table" axis="0 0 1"/><geom type="cylinder" size=".5 .02" mass="3"/>
<body pos=".4 0 .5"><joint name="arm" axis="0 1 0" frictionloss="0.02"/>
<geom type="capsule" fromto="0 0 0 .1 0 -.4" size=".02" mass=".3"/></body></body></worldbody>
<actuator><motor name="rig" joint="table"/></actuator></mujoco>"""


def test_constraints_of_what_it_carries_are_those_of_the_whole_machine() -> None:
    """Dry friction of an arm on a turntable, against MuJoCo's own simulation of both with the rig's torque."""
    model = mujoco.MjModel.from_xml_string(TABLE)
    data = mujoco.MjData(model)
    rows = []
    for k in range(1001):
        if k % 5 == 0:
            rows.append([data.time, *data.qpos, *data.qvel])
        data.ctrl[:] = 4 * np.sin(2 * np.pi * 1.1 * data.time + 0.7)
        mujoco.mj_step(model, data)
    table = np.array(rows)
    columns = {"time": table[:, 0], "qpos.table": table[:, 1], "qpos.arm": table[:, 2]}
    recording = Recording.from_columns("turn", columns, prescribed=("table",))
    channels = Channels.of(model, [recording])
    read = Engine(model, channels, 5, 1).predict(
        cut([make_run(recording, model, channels)], 9.0, 0.0), table[:1, None, 1:], [NOMINAL]
    )
    assert np.ptp(table[:, 2]) > 0.2
    np.testing.assert_allclose(read[0, 0, :, 0], table[:, 2], atol=1e-7)


def test_actuators_on_the_joint_alone_are_known(double) -> None:
    model = double.model()
    channels = Channels.of(model, [double.record(3, seconds=1.0)])
    assert channels.prescribed is not None
    assert only_on(model, channels.prescribed).tolist() == [True, False]
    assert only_on(model, channels).tolist() == [False, True]
