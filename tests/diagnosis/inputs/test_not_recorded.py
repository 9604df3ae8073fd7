from __future__ import annotations

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.not_recorded import unrecorded, unseen

NO_CONTROL = (
    "no control is recorded (ctrl.drive); taken as 0. If the machine was driven, nothing can explain its motion so: "
    "record them."
)


def test_a_control_that_is_missing_is_noted(model, record) -> None:
    machine = make_machine(model, [record(name="a", ctrl__drive=None)], [record()])
    assert machine.notes == ("a: " + NO_CONTROL,)
    assert not machine.fit[0].control.any()


def test_a_control_among_others_that_is_missing_is_noted_and_doubted(bench, record) -> None:
    twice = bench.xml.replace("</actuator>", '<motor name="second" joint="hip"/></actuator>')
    runs = [record(name="a"), record(name="b"), record(name="c", ctrl__second=np.zeros(201))]
    machine = make_machine(mujoco.MjModel.from_xml_string(twice), runs, [record(ctrl__second=np.zeros(201))])
    note = "a, b: no ctrl.second; taken as 0. If such a drive moved it, nothing can explain its motion so: record it."
    assert machine.notes == machine.lacks == (note,)
    assert machine.doubts + machine.undriven == ()  # nothing is taken back for a drive that may have rested


def test_what_is_true_of_all_is_noted_once(model, record) -> None:
    runs = [record(name=name, ctrl__drive=None) for name in "abc"]
    machine = make_machine(model, runs, runs[:1])
    (note,) = machine.notes
    assert note.startswith("all recordings: no control is recorded (ctrl.drive)")
    assert [doubt[:37] for doubt in machine.undriven] == ["all recordings: no control is recorde"]
    some = make_machine(model, [*runs[:2], record(name="d")], [record(name="e")])
    assert [note[:31] for note in some.notes] == ["a, b: no control is recorded (c"]
    assert make_machine(model, [record()], [record()]).undriven == ()


def test_joints_without_a_position_are_listed_by_the_names_that_columns_have(clean) -> None:
    knee = '<body><joint/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>'
    two = clean.xml.replace("</body></worldbody>", f"{knee}</body></worldbody>")
    model = mujoco.MjModel.from_xml_string(two)
    assert unrecorded(model, clean.machine.channels) == ["joint1"]
    (note,) = unseen(model, clean.machine.channels)
    assert note.startswith("Not in all recordings: qpos.joint1; simulated, but compared with nothing")
    assert unseen(clean.machine.model, clean.machine.channels) == []
