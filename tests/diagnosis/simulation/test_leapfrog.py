from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.leapfrog import halve_damping, is_of_second_order, servo_damping

DAMPED = 'name="hip" damping="0.8"'
MOTOR = '<motor name="drive" joint="hip"/>'
SERVO = '<position name="drive" joint="hip" gear="2" kp="3" kv="0.2"/>'


def damped(clean, joint: str = DAMPED, drive: str = "") -> mujoco.MjModel:
    text = clean.xml.replace('name="hip"', joint, 1)
    return mujoco.MjModel.from_xml_string(text.replace(MOTOR, drive) if drive else text)


def error(clean, model: mujoco.MjModel, steps: int, stride: int = 1, effects=(), values=()) -> float:
    """What a form leaves of a fine simulation, once its initial states are fitted to that."""
    candidate = dataclasses.replace(clean.nominal.candidate, effects=effects, values=values)
    exact = Engine(model, clean.engine.channels, 40, 1, int(mujoco.mjtIntegrator.mjINT_RK4))
    truth = exact.predict(clean.segments, clean.nominal.starts[None], [candidate])[0]
    form = Engine(model, clean.engine.channels, steps, 1, stride=stride, late=True)
    segments = dataclasses.replace(clean.segments, position=truth)
    shooting = dataclasses.replace(clean.shooting, engine=form, segments=segments)
    fit: Fit = shooting.fit([(effects, values)], clean.nominal.starts, hold=True)[0]
    return float(np.sqrt(fit.chi2))


@pytest.mark.parametrize("drive", ["", SERVO])
def test_damping_is_of_second_order(clean, drive: str) -> None:
    model = damped(clean, drive=drive)
    assert error(clean, model, 2) < 0.35 * error(clean, model, 1)


def test_damping_is_of_second_order_over_several_rows_too(clean) -> None:
    model = damped(clean)
    assert error(clean, model, 1, stride=2) < 6.0 * error(clean, model, 1)


def test_damping_that_an_effect_changes_is_of_second_order_too(clean) -> None:
    model, changed = damped(clean, 'name="hip"'), ((clean.effect("viscous_friction"),), (np.array([0.8]),))
    assert error(clean, model, 2, 1, *changed) < 0.35 * error(clean, model, 1, 1, *changed)


def test_where_nothing_damps_nothing_is_changed(clean) -> None:
    def field(name: str) -> np.ndarray:
        assert name == "dof_damping", name
        return np.zeros((3, 1))

    halve_damping(damped(clean, 'name="hip"'), field, 3, np.full(3, 0.01))


def test_the_inertia_stays_positive_behind_a_stiff_damper(clean) -> None:
    model = damped(clean, 'name="hip" damping="1000"')
    fields = {name: np.tile(getattr(model, name), (2, 1)) for name in ("dof_damping", "dof_armature", "dof_M0")}
    halve_damping(model, fields.__getitem__, 1, np.full(1, 0.01))
    least = 1.0 / model.dof_invweight0[0]
    np.testing.assert_allclose(fields["dof_armature"][:, 0], [-0.5 * least, 0.0])
    np.testing.assert_allclose(fields["dof_M0"][:, 0], model.dof_M0[0] + fields["dof_armature"][:, 0])


def test_each_simulation_is_damped_by_its_own_steps(clean) -> None:
    model = damped(clean)
    fields = {name: np.tile(getattr(model, name), (2, 1)) for name in ("dof_damping", "dof_armature", "dof_M0")}
    halve_damping(model, fields.__getitem__, 2, np.array([0.001, 0.002]))
    added = fields["dof_armature"][:, 0] - model.dof_armature[0]
    assert added[1] == pytest.approx(2.0 * added[0])
    assert added[0] < 0.0


def test_what_a_servo_damps(clean) -> None:
    assert servo_damping(damped(clean)).tolist() == [0.0]
    assert servo_damping(damped(clean, drive=SERVO)) == pytest.approx([0.8])
    driven = '<general name="drive" joint="hip" gear="2" biastype="affine" biasprm="0 0 0.2"/>'
    assert servo_damping(damped(clean, drive=driven)).tolist() == [0.0]
    assert servo_damping(damped(clean, drive=SERVO.replace("kp", 'forcerange="-1 1" kp'))).tolist() == [0.0]


TWO = """
<mujoco><option timestep="0.005"/><worldbody><body><joint name="a" {}/><geom size="0.1 0.5" type="capsule"/>
<body pos="0 0 0.7"><joint name="b" {}/><geom size="0.1 0.5" type="capsule" pos="0.3 0 0.2"/></body></body></worldbody>
</mujoco>"""


@pytest.mark.parametrize(
    ("joints", "second"),
    [
        (('axis="0 1 0"', 'axis="0 1 0"'), False),
        (('axis="1 0 0" type="slide"', 'axis="0 1 0"'), False),
        (('axis="1 0 0" type="slide" damping="3"', 'axis="0 1 0" type="slide"'), True),
    ],
)
def test_it_is_not_where_coriolis_forces_act(joints: tuple[str, str], second: bool) -> None:
    assert is_of_second_order(mujoco.MjModel.from_xml_string(TWO.format(*joints))) is second


def test_it_is_not_in_a_thick_medium_or_behind_a_damping_servo(clean) -> None:
    assert is_of_second_order(damped(clean, drive=SERVO.replace('kv="0.2"', "")))
    assert not is_of_second_order(damped(clean, drive=SERVO))  # whose force may end somewhere
    assert not is_of_second_order(damped(clean, drive=SERVO.replace("kp", 'forcerange="-1 1" kp')))
    medium = clean.xml.replace("<option ", '<option density="1000" ')
    assert not is_of_second_order(mujoco.MjModel.from_xml_string(medium))


def test_the_damping_of_a_servo_counts_behind_an_actuator_without_input_and_one_elsewhere(clean) -> None:
    loss = '<dcmotor name="loss" joint="hip" motorconst="0 0" resistance="1" input="none"/>'
    text = clean.xml.replace(MOTOR, loss + SERVO)
    np.testing.assert_allclose(servo_damping(mujoco.MjModel.from_xml_string(text)), [0.8])
    cables = "".join(f'<fixed name="cable{i}"><joint joint="hip" coef="1"/></fixed>' for i in range(3))
    text = clean.xml.replace(MOTOR, '<position tendon="cable2" kp="3" kv="0.2"/>' + SERVO)
    text = text.replace("<actuator>", f"<tendon>{cables}</tendon><actuator>")
    np.testing.assert_allclose(servo_damping(mujoco.MjModel.from_xml_string(text)), [0.8])
