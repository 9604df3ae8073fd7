from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import check_given, make_machine, recording_notes
from torch_activegp.errors import DataError


def test_given_runs_are_kept_apart(model, record) -> None:
    machine = make_machine(model, [record(name="a"), record(name="b")], [record(name="c")])
    assert [run.label for run in machine.fit] == ["a", "b"]
    assert [run.label for run in machine.holdout] == ["c"]
    assert machine.notes == ()


def test_runs_of_other_rates_are_laid_on_the_clock_of_the_fastest(model, record) -> None:
    fast = record(name="fast", seconds=2.0)
    slow = record(name="slow", seconds=2.0)
    every = {name: slow[name][::5] for name in slow.columns}
    thinned = Recording.from_columns("slow", every)
    machine = make_machine(model, [fast], [thinned])
    (run,) = machine.holdout
    assert len(run) == len(slow) == len(machine.fit[0])
    assert run.recorded.sum() == len(thinned)
    np.testing.assert_array_equal(run.position[::5, 0], every["qpos.hip"])
    np.testing.assert_array_equal(run.control[::5, 0], every["ctrl.drive"][:-1])
    np.testing.assert_allclose(run.dt, machine.fit[0].dt)


def test_a_joint_with_a_velocity_alone_is_noted(bench, record) -> None:
    twice = bench.xml.replace("</worldbody>", '<body><joint name="knee"/><geom size=".1"/></body></worldbody>')
    given = record(name="a", qvel__knee=np.zeros(201))
    machine = make_machine(mujoco.MjModel.from_xml_string(twice), [given], [record()])
    unseen = (
        "Not in all recordings: qpos.knee; simulated, but compared with nothing: what acts on these joints is seen "
        "through the others alone. "
    )
    qvel = "a: qvel.knee without qpos.knee; knee counts as not measured. Record it."
    assert machine.notes == (f"{unseen}Record them if you can.", qvel)
    assert make_machine(bench.machine.model, [record(name="a")], [record()]).notes == ()
    assert machine.channels.joints == ("hip",)


@pytest.mark.parametrize(("seconds", "said"), [(0.5, True), (1.2, False)])
def test_that_little_was_recorded_is_noted(model, record, seconds: float, said: bool) -> None:
    runs = [record(name=name, seconds=seconds) for name in ("a", "b")]
    assert [note[:17] for note in make_machine(model, runs, [record()]).notes] == ["Only 1 s are fitt"] * said


def test_no_recording_is_refused(model) -> None:
    with pytest.raises(DataError, match="no recording to fit"):
        make_machine(model, [], [])


def test_a_position_that_never_changes_is_refused(model, record) -> None:
    still = record(name="still", qpos__hip=np.full(201, 0.3))
    with pytest.raises(DataError, match=r"still, column `qpos\.hip`: the same value in every row"):
        make_machine(model, [still, still], [])
    assert len(make_machine(model, [still, record()], [record()]).fit) == 2


def test_noise_without_motion_is_refused(model, record) -> None:
    rest = record(name="rest", qpos__hip=1e-3 * np.random.default_rng(0).normal(size=201))
    with pytest.raises(DataError, match="rest: no excitation, every position stays within its noise"):
        make_machine(model, [rest], [record()])


def test_an_actuator_without_input_needs_no_control(bench, record) -> None:
    loss = '<dcmotor name="loss" joint="hip" motorconst="0 0" resistance="1" input="none"/><motor'
    machine = make_machine(mujoco.MjModel.from_xml_string(bench.xml.replace("<motor", loss)), [record()], [record()])
    assert machine.notes == ()
    np.testing.assert_array_equal(machine.fit[0].control[:, 0], record()["ctrl.drive"].numpy()[:-1])


def test_what_prescribed_means_is_noted_and_it_may_rest(double) -> None:
    still = [double.record(seed, seconds=1.0) for seed in (0, 1)]
    still = [run.replace({"qpos.shoulder": 0.0 * run.time + 0.2}) for run in still]
    machine = make_machine(double.model(), still, [])
    assert machine.notes[0].startswith("Prescribed: shoulder. Simulations follow the recorded motion there")
    head, tail = machine.fit[1].prescribed, machine.holdout[0].prescribed
    assert head is not None and tail is not None
    assert (len(head), len(tail)) == (len(machine.fit[1]), len(machine.holdout[0]))
    np.testing.assert_allclose(tail.smooth, 0.2)


def test_one_recording_may_come_without_a_list(record) -> None:
    one = record()
    assert check_given(one, "diagnose") == [one] == check_given((one,), "diagnose")


def test_a_glitch_is_noted_with_its_recording(model, record) -> None:
    run = record(name="a")
    position = run["qpos.hip"].clone()
    position[50] += 1.0
    machine = make_machine(model, [run.replace({"qpos.hip": position})], [record(name="b")])
    (note,) = machine.notes
    assert note.startswith("a: a row left out, at 0.5 s: qpos.hip is far")


def test_what_was_decided_about_a_file_is_noted_once(model, record, tmp_path) -> None:
    parts = [dataclasses.replace(record(name=f"f (run {i})"), source=tmp_path / "f", notes=("Gap.",)) for i in (1, 2)]
    assert make_machine(model, parts, [record()]).notes == ("f (run 1): Gap.",)


def test_what_is_so_of_several_recordings_is_said_once(bench, record) -> None:
    left_out, gap = "Columns left out: u.", "Gap."
    runs = [dataclasses.replace(record(name=name), notes=(left_out,)) for name in "abc"]
    runs[1] = dataclasses.replace(runs[1], notes=(left_out, gap))
    assert recording_notes(bench.machine.model, runs) == [f"a and 2 more: {left_out}", f"b: {gap}"]
