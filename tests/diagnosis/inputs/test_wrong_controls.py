from __future__ import annotations

import dataclasses
import itertools

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs import wrong_controls
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.wrong_controls import doubt_controls, servo_order
from torch_activegp.diagnosis.inputs.wrong_signs import check_signs
from torch_activegp.errors import DataError

XML = """
<mujoco><option timestep="0.002"/><worldbody>
<body><joint name="slide" type="slide" axis="1 0 0" damping="1"/><geom size=".1" mass="2"/></body>
<body pos="0 1 0"><joint name="rod" axis="0 1 0" damping=".05"/><geom type="capsule" fromto="0 0 0 0 0 -.5" size=".02"/>
</body></worldbody>
<actuator><motor name="push" joint="slide"/><motor name="drive" joint="rod"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def records():
    """A slide on a spring and a rod with friction, neither of which the model has."""

    model = mujoco.MjModel.from_xml_string(XML)
    model.jnt_stiffness[0], model.dof_frictionloss[1] = 60.0, 0.05

    def make(scale: float = 1.0) -> list[Recording]:
        time, runs = np.arange(0.0, 6.0, 0.01), []
        rng = np.random.default_rng(0)
        for number in range(3):
            data, rows = mujoco.MjData(model), []
            control = np.stack([9.0 * np.sin((2.0 + number) * time), 1.5 * np.sin((3.0 + number) * time)], axis=1)
            for u in control:
                rows.append(data.qpos.copy())
                data.ctrl[:] = u
                mujoco.mj_step(model, data, 5)
            position = np.array(rows) + 1e-4 * rng.standard_normal((len(time), 2))
            columns = {"time": time, "qpos.slide": position[:, 0], "qpos.rod": position[:, 1]}
            columns |= {"ctrl.push": scale * control[:, 0], "ctrl.drive": control[:, 1]}
            runs.append(Recording.from_columns(f"run{number}", columns))
        return runs

    return make


def doubts(runs: list[Recording]) -> list[str]:
    model = mujoco.MjModel.from_xml_string(XML)
    machine = make_machine(model, runs, [])
    found = doubt_controls(model, machine.channels, machine.fit)
    assert sum(note.startswith("Column `ctrl") for note in machine.notes) == len(found)
    return found


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (
            -1.0,
            (
                "the sign seems",
                "as if -0.9",
                'ctrl.push = { column = "...", sign = -1 }, or without that where it is there.',
            ),
        ),
        (
            1e3,
            (
                "the unit seems",
                'ctrl.push = { column = "...", scale = 1e-3 }, times any scale there; or the positions\' unit is the '
                "wrong one.",
            ),
        ),
        (1e-2, ("the unit seems", "scale = 1e2")),
    ],
)
def test_a_sign_or_a_unit_is_doubted_beside_what_else_is_missing(records, scale: float, words: tuple[str, ...]) -> None:
    (text,) = doubts(records(scale))
    assert all(word in text for word in words)


def test_controls_of_several_joints_are_doubted(records) -> None:
    runs = [run.replace({"ctrl.push": -run["ctrl.push"], "ctrl.drive": 100.0 * run["ctrl.drive"]}) for run in records()]
    found = doubts(runs)
    assert {text.partition(":")[0] for text in found} == {"Column `ctrl.push`", "Column `ctrl.drive`"}


def test_what_one_joint_does_not_tell_of_a_control_another_one_may(records, monkeypatch) -> None:
    told = itertools.cycle([np.array([np.nan]), np.array([-1.0])])
    monkeypatch.setattr(wrong_controls, "_pushes", lambda *rest: np.arange(6.0).reshape(3, 2) * [1.0, 0.0])
    monkeypatch.setattr(wrong_controls, "_factors", lambda *rest: next(told))
    monkeypatch.setattr(wrong_controls, "_LACKS", 0.0)
    (text,) = doubts(records())
    assert text.startswith("Column `ctrl.push`: the sign")


def test_where_a_position_could_be_in_another_unit_as_well_both_are_told(records) -> None:
    words = r"qpos\.slide` .* unit = \"mm\" .* Or another column is: Column `ctrl\.push`.*scale = 1e3"
    with pytest.raises(DataError, match=words.replace(" .* ", ".*")):
        doubts(records(1e-3))


@pytest.mark.parametrize("scale", [1.0, 1.6, 0.3])
def test_controls_as_they_are_and_wrong_gains_are_not_doubted(records, scale: float) -> None:
    assert doubts(records(scale)) == []


def test_the_refusal_of_signs_does_not_see_this_one(records) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    machine = make_machine(model, records(-1.0), [])
    check_signs(model, machine.channels, machine.fit)


def test_where_motion_is_prescribed_nothing_is_said(records) -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    machine = make_machine(model, records(-1.0), [])
    channels = dataclasses.replace(machine.channels, prescribed=machine.channels)
    assert doubt_controls(model, channels, machine.fit) == []


def test_what_nothing_explains_is_not_blamed_on_a_control(records) -> None:
    runs = [run.replace({"ctrl.push": run["ctrl.push"].flip(0)}) for run in records()]
    assert doubts(runs) == []


SERVO = """
<mujoco><option timestep="0.002"/><worldbody>
<body><joint name="hip" axis="0 1 0" damping=".2"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02"/></body>
</worldbody><actuator>{}</actuator></mujoco>"""


def driven(actuator: str, factor: float) -> list[str]:
    """Doubts about a servo whose command is written down in another unit."""
    model = mujoco.MjModel.from_xml_string(SERVO.format(actuator))
    time, runs = np.arange(0.0, 4.0, 0.01), []
    for number in range(2):
        data, rows, control = mujoco.MjData(model), [], 0.6 * np.sin((3.0 + number) * time)
        for u in control:
            rows.append(data.qpos[0])
            data.ctrl[:] = u
            mujoco.mj_step(model, data, 5)
        columns = {"time": time, "qpos.hip": np.array(rows), "ctrl.servo": factor * control}
        runs.append(Recording.from_columns(f"run{number}", columns))
    return list(make_machine(model, runs, []).doubts)


@pytest.mark.parametrize(
    ("actuator", "factor", "unit"),
    [
        ('<position name="servo" joint="hip" kp="8" kv=".4"/>', 180 / np.pi, "deg"),
        ('<velocity name="servo" joint="hip" kv="0.2"/>', 180 / np.pi, "deg/s"),
        ('<velocity name="servo" joint="hip" kv="0.2"/>', 30 / np.pi, "rpm"),
    ],
)
def test_a_servo_whose_command_is_in_degrees_or_rpm_is_doubted(actuator: str, factor: float, unit: str) -> None:
    (text,) = driven(actuator, factor)
    assert f"the unit seems to be {unit}. " in text
    assert f'ctrl.servo = {{ column = "...", unit = "{unit}" }}, in place of any unit there.' in text
    assert driven(actuator, 1.0) == []


def test_a_motor_whose_force_is_far_off_is_not_taken_for_a_servo() -> None:
    assert driven('<motor name="servo" joint="hip"/>', 180 / np.pi) == []


@pytest.mark.parametrize(
    ("actuator", "order"),
    [
        ('<position name="servo" joint="hip"/>', 1),
        ('<velocity name="servo" joint="hip"/>', 2),
        ('<motor name="servo" joint="hip"/>', 0),
        ('<general name="servo" joint="hip" biastype="affine" biasprm="1 0 0"/>', 0),
        ('<general name="servo" joint="hip" gainprm="2" biastype="affine" biasprm="0 0 -.3"/>', 0),  # back-EMF
        ('<general name="servo" joint="hip" gainprm="8" biastype="affine" biasprm="0 -8 -.1"/>', 1),
        ('<position name="servo" tendon="cord"/>', 0),
        ('<position name="servo" joint="rail"/>', 0),
    ],
)
def test_what_a_servo_leads_a_hinge_to(actuator: str, order: int) -> None:
    text = SERVO.format(actuator).replace("<geom", '<joint name="rail" type="slide"/><geom')
    cord = '<tendon><fixed name="cord"><joint joint="hip" coef="1"/></fixed></tendon>'
    assert servo_order(mujoco.MjModel.from_xml_string(text.replace("</mujoco>", f"{cord}</mujoco>")), 0) == order


def test_actuators_need_no_names(records) -> None:
    """The model then counts them; one without a control comes first."""
    xml = XML.replace(' name="push"', "").replace(' name="drive"', "")
    xml = xml.replace("<actuator>", '<actuator><dcmotor joint="rod" motorconst="1" resistance="1" input="none"/>')
    runs = []
    for run in records(-1.0):
        columns = {key: run[key].numpy() for key in ("qpos.slide", "qpos.rod")}
        columns |= {"ctrl.actuator1": run["ctrl.push"].numpy(), "ctrl.actuator2": run["ctrl.drive"].numpy()}
        runs.append(Recording.from_columns(run.label, {"time": run.time.numpy(), **columns}))
    machine = make_machine(mujoco.MjModel.from_xml_string(xml), runs, [])
    assert any("Column `ctrl.actuator1`: the sign" in text for text in machine.doubts)
