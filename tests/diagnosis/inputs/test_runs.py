from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest
import torch

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.runs import Channels, input_addresses, make_run
from torch_activegp.errors import DataError

TWO = """
<mujoco><compiler autolimits="true"/><worldbody><body><freejoint name="float"/><geom size=".1"/></body>
<body pos="0 0 1"><joint name="lift" type="slide" axis="0 0 1"/><geom size=".1"/>
<body><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body></body></worldbody>
<actuator><dcmotor name="loss" joint="lift" motorconst="0 0" resistance="1" input="none"/>
<motor name="lifter" joint="lift"/></actuator></mujoco>"""


def recording(**columns: object) -> Recording:
    time = np.arange(30) * 0.01
    base = {"time": time, "qpos.lift": time**2}
    return Recording.from_columns("file.csv", {**base, **{k.replace("__", "."): v for k, v in columns.items()}})


@pytest.fixture(scope="module")
def two() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(TWO)


def test_channels_are_the_joints_that_all_recordings_hold(two) -> None:
    both = recording(qpos__joint2=np.linspace(0.0, 1.0, 30))
    channels = Channels.of(two, [both, both])
    assert channels.joints == ("lift", "joint2")
    assert channels.qpos.tolist() == [7, 8]
    assert channels.dof.tolist() == [6, 7]
    assert channels.units == ["m", "rad"]
    assert Channels.of(two, [both, recording()]).joints == ("lift",)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"qpos__knee": np.ones(30)}, r"file\.csv, column `qpos\.knee`: the model has no joint `knee`; .*lift"),
        ({"qpos__float": np.ones(30)}, r"column `qpos\.float`: a hinge or a slide wanted, found a free or ball"),
        ({"ctrl__pump": np.ones(30)}, r"column `ctrl\.pump`: the model has no actuator `pump`; its actuators are lif"),
        ({"ctrl__loss": np.ones(30)}, r"the model has no actuator `loss`"),
    ],
)
def test_a_column_that_does_not_fit_the_model_is_refused(two, columns, words) -> None:
    with pytest.raises(DataError, match=words):
        Channels.of(two, [recording(**columns)])


def test_recordings_without_a_common_joint_are_refused(two) -> None:
    time = np.arange(30) * 0.01
    other = Recording.from_columns("b", {"time": time, "qpos.joint2": time})
    with pytest.raises(DataError, match="no joint has a position in all recordings"):
        Channels.of(two, [recording(), other])


def test_a_run_holds_the_recorded_columns_at_their_addresses(two) -> None:
    push = np.linspace(0.0, 2.0, 30)
    noted = recording(ctrl__lifter=push, qfrc__joint2=3 * push)
    run = make_run(noted, two, Channels.of(two, [noted]))
    assert input_addresses(two) == {"lifter": 0}
    assert run.control.shape == (29, 1) and run.force.shape == (29, 8)
    np.testing.assert_array_equal(run.control[:, 0], push[:-1])
    np.testing.assert_array_equal(run.force[:, 7], 3 * push[:-1])
    np.testing.assert_allclose(run.position[:, 0], run.time**2)
    np.testing.assert_allclose(run.velocity[3:-3, 0], 2 * run.time[3:-3], atol=0.01)
    assert run.recorded.all() and len(run) == 30


def test_a_force_on_a_joint_that_cannot_take_one_number_is_refused(two) -> None:
    for name in ("float", "knee"):
        noted = recording(**{f"qfrc__{name}": np.ones(30)})
        with pytest.raises(DataError, match=rf"column `qfrc\.{name}`: a hinge or a slide of the model wanted"):
            make_run(noted, two, Channels.of(two, [recording()]))


def test_dropped_rows_are_filled_and_do_not_count(two) -> None:
    time = np.delete(np.arange(30) * 0.01, [10, 11, 20])
    noted = Recording.from_columns("gap", {"time": time, "qpos.lift": time, "ctrl.lifter": time})
    run = make_run(noted, two, Channels.of(two, [noted]))
    assert np.flatnonzero(~run.recorded).tolist() == [10, 11, 20]
    np.testing.assert_allclose(run.time, np.arange(30) * 0.01, atol=1e-12)
    np.testing.assert_allclose(run.position[:, 0], run.time, atol=1e-12)
    np.testing.assert_allclose(run.control[9:13, 0], [0.09, 0.09, 0.09, 0.12])


def test_a_recording_that_is_too_short_is_refused(two) -> None:
    time = np.arange(11) * 0.01
    short = Recording.from_columns("short", {"time": time, "qpos.lift": time})
    with pytest.raises(DataError, match="short: too short, 11 rows found, 12 wanted"):
        make_run(short, two, Channels.of(two, [short]))


@pytest.mark.parametrize("row", [10.0, 1.0])
def test_a_clock_that_counts_something_else_is_refused(two, row: float) -> None:
    """At 100 Hz and at 1 kHz."""
    time = np.arange(40) * row
    slow = Recording.from_columns("slow", {"time": time, "qpos.lift": np.sin(time)})
    with pytest.raises(DataError, match=r"slow, column `time`: seconds wanted, found a row every 1.*unit = \"ms\""):
        make_run(slow, two, Channels.of(two, [slow]))


def test_smoothing_frees_positions_and_velocities_of_noise(bench) -> None:
    run = bench.machine.fit[0]
    assert run.noise[0] == pytest.approx(bench.noise, rel=0.2)
    true = np.gradient(run.smooth[:, 0], run.time)
    assert np.abs(run.velocity[5:-5, 0] - true[5:-5]).std() < 0.2
    assert 0 < (run.smooth - run.position).std() < 1.2 * bench.noise


def test_angles_are_unwrapped(model, channels, record) -> None:
    time = np.arange(201) / 100
    turning = record(qpos__hip=np.angle(np.exp(1j * 4 * time)))
    run = make_run(turning, model, channels)
    np.testing.assert_allclose(run.position[:, 0], 4 * time, atol=1e-9)


def test_prescribed_joints_are_no_channels(double) -> None:
    recording = double.record(0, seconds=1.0)
    channels = Channels.of(double.model(), [recording, recording])
    assert (channels.joints, channels.dof.tolist()) == (("elbow",), [1])
    assert channels.prescribed is not None
    assert (channels.prescribed.joints, channels.prescribed.qpos.tolist()) == (("shoulder",), [0])
    run = make_run(recording, double.model(), channels)
    assert run.position.shape == run.smooth.shape == (101, 1)
    assert run.prescribed is not None and run.coupling is not None
    assert run.coupling.shape == (1, 1)
    q, v, _ = double.path(recording.time.numpy(), 0)
    np.testing.assert_allclose(run.prescribed.smooth[:, 0], q, atol=1e-6)
    np.testing.assert_allclose(run.prescribed.velocity[:, 0], v, atol=1e-4)


def test_prescribed_motion_is_followed_within_its_noise_and_not_smoothed_away(double) -> None:
    recording = double.record(0, noise=0.01)
    run = make_run(recording, double.model(), Channels.of(double.model(), [recording]))
    assert run.prescribed is not None
    q, v, _ = double.path(recording.time.numpy(), 0)
    assert run.prescribed.noise[0] == pytest.approx(1e-3, rel=0.2)
    assert (run.prescribed.smooth[:, 0] - q).std() < 0.5e-3
    assert np.abs(run.prescribed.velocity[:, 0] - v)[20:-20].max() < 0.05


def test_joints_that_cannot_be_prescribed_are_refused(double) -> None:
    model, one, other = double.model(), double.record(0, seconds=1.0), double.record(1, seconds=1.0, prescribed=())
    with pytest.raises(
        DataError, match="the same prescribed joints in all recordings wanted, found shoulder in run0 and n"
    ):
        Channels.of(model, [one, other])
    both = double.record(0, seconds=1.0, prescribed=("shoulder", "elbow"))
    with pytest.raises(
        DataError, match="run0: a recorded joint to explain wanted, found that all of them are prescribed"
    ):
        Channels.of(model, [both])
    strange = Recording.from_columns(
        "b", {"time": np.arange(30) * 0.01, "qpos.elbow": np.ones(30), "qpos.table": np.ones(30)}, prescribed=("table",)
    )
    with pytest.raises(DataError, match=r"b, column `qpos\.table`: the model has no joint `table`"):
        Channels.of(model, [strange])


def test_a_glitch_counts_for_nothing(two) -> None:
    signal = np.sin(np.arange(60) * 0.05) + 1e-4 * np.random.default_rng(0).normal(size=60)
    clean = Recording.from_columns("a", {"time": np.arange(60) * 0.01, "qpos.lift": signal})
    channels = Channels.of(two, [clean])
    signal = signal.copy()
    signal[30] += 0.5
    run = make_run(clean.replace({"qpos.lift": torch.from_numpy(signal)}), two, channels)
    assert np.flatnonzero(~run.counted).tolist() == [30]
    assert run.recorded.all()
    assert run.notes == ("a row left out, at 0.3 s: qpos.lift is far from where the rows around it put it.",)
    np.testing.assert_allclose(run.smooth, make_run(clean, two, channels).smooth, atol=1e-3)
    assert make_run(clean, two, channels).counted.all()


def test_a_glitch_beside_dropped_rows_is_the_right_one(two) -> None:
    rows = np.r_[0:20, 23:60]
    signal = np.sin(rows * 0.05) + 1e-4 * np.random.default_rng(0).normal(size=57)
    signal[30] -= 0.5
    made = Recording.from_columns("a", {"time": rows * 0.01, "qpos.lift": signal})
    run = make_run(made, two, Channels.of(two, [made]))
    assert np.flatnonzero(~run.recorded).tolist() == [20, 21, 22]
    assert np.flatnonzero(~run.counted).tolist() == [20, 21, 22, 33]


def test_a_glitch_of_a_prescribed_joint_is_told(two) -> None:
    signal = np.sin(np.arange(60) * 0.05) + 1e-4 * np.random.default_rng(0).normal(size=60)
    columns = {"time": np.arange(60) * 0.01, "qpos.lift": signal, "qpos.joint2": signal.copy()}
    columns["qpos.lift"][30] += 0.5
    made = dataclasses.replace(Recording.from_columns("a", columns), prescribed=("lift",))
    run = make_run(made, two, Channels.of(two, [made]))
    assert run.notes == ("a row left out, at 0.3 s: qpos.lift is far from where the rows around it put it.",)
    assert run.counted.all()
