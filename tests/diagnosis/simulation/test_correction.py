from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.simulation.correction import Form, corrected_xml
from torch_activegp.diagnosis.simulation.explicit_damping import is_explicit
from torch_activegp.physics import Effect, Place
from torch_activegp.physics.actuation import ActuatorGain, ActuatorSaturation


@pytest.fixture
def spec(bench) -> mujoco.MjSpec:
    return mujoco.MjSpec.from_string(bench.xml)


def test_an_effect_is_in_the_model_that_is_written(bench, spec) -> None:
    before = spec.to_xml()
    text, held, difference = corrected_xml(spec, [bench.effect("viscous_friction")], [np.array([0.06])], None)
    assert mujoco.MjModel.from_xml_string(text).dof_damping[0] == pytest.approx(0.06)
    assert held == [True]
    assert spec.to_xml() == before
    added = [line for line in difference.splitlines() if line.startswith("+ ")]
    assert any('damping="0.06"' in line for line in added)


def test_numerics_are_written_too(spec) -> None:
    implicit = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)
    text, held, _ = corrected_xml(spec, [], [], Form(implicit, 0.0025))
    model = mujoco.MjModel.from_xml_string(text)
    assert (model.opt.integrator, model.opt.timestep, held) == (implicit, 0.0025, [])


def test_explicit_damping_is_written_and_what_is_read_integrates_so(spec) -> None:
    euler = int(mujoco.mjtIntegrator.mjINT_EULER)
    made = {way: corrected_xml(spec, [], [], Form(euler, 0.001, explicit=way))[0] for way in (True, False)}
    assert {way: is_explicit(mujoco.MjModel.from_xml_string(text)) for way, text in made.items()} == {
        True: True,
        False: False,
    }


def test_friction_that_sticks_firmly_is_written_where_there_is_some(bench) -> None:
    spec = mujoco.MjSpec.from_string(bench.xml.replace('name="hip"', 'name="hip" frictionloss="0.6"', 1))
    for rubbing, solref in ((spec, 0.002), (mujoco.MjSpec.from_string(bench.xml), 0.02)):
        text, *_ = corrected_xml(rubbing, [], [], Form(1, 0.001, firm=True))
        assert mujoco.MjModel.from_xml_string(text).dof_solref[0, 0] == pytest.approx(solref)


def test_what_mjcf_cannot_hold_is_said(bench, spec) -> None:
    delay = bench.effect("sensor_delay", "sensor:hip")
    assert corrected_xml(spec, [delay], [np.array([0.02])], None) == (None, [False], None)
    both = [delay, bench.effect("viscous_friction")]
    text, held, _ = corrected_xml(spec, both, [np.array([0.02]), np.array([0.1])], None)
    assert held == [False, True]
    assert mujoco.MjModel.from_xml_string(text).dof_damping[0] == pytest.approx(0.1)


def test_effects_on_a_drive_are_written_in_its_chain(bench) -> None:
    """A servo's file limits the control, which is right only where no gain stands before the limit."""
    servo = mujoco.MjSpec.from_string(bench.xml.replace("<motor ", '<position kp="3" '))
    model, place = servo.compile(), Place("actuator:drive", 0, control=1.0)
    effects = [ActuatorSaturation.at(place, model), ActuatorGain.at(place, model)]
    _, held, _ = corrected_xml(servo, effects, [np.array([0.5]), np.array([0.2])], None)
    assert held == [False, True]


@pytest.mark.parametrize("turned", [False, True])
def test_a_stop_is_as_stiff_as_it_should_be_whatever_comes_before_it(bench, spec, turned: bool) -> None:
    """Its stiffness is written for the inertia that the joint has in the end."""
    some = [
        (bench.effect("joint_stop"), np.array([100.0, 1.0, 0.3])),
        (bench.effect("armature_error"), np.array([0.33])),
    ]
    effects, values = zip(*(some[::-1] if turned else some), strict=True)
    text, held, _ = corrected_xml(spec, effects, values, None)
    assert held == [True, True]
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.4
    mujoco.mj_forward(model, data)
    assert data.qfrc_constraint[0] == pytest.approx(-10.0, rel=0.02)


def test_without_effects_the_model_stays_the_same(spec) -> None:
    text, _, difference = corrected_xml(spec, [], [], None)
    assert (text, difference) == (spec.to_xml(), "")


class Broken(Effect):
    """Writes what does not compile."""

    def write(self, spec: mujoco.MjSpec, values: np.ndarray) -> bool:
        spec.add_actuator(trntype=mujoco.mjtTrn.mjTRN_JOINT, target="nowhere")
        return True


def test_a_model_that_does_not_compile_is_not_written(spec) -> None:
    broken = Broken("joint:hip", (), np.zeros((1, 0)))
    assert corrected_xml(spec, [broken], [np.zeros(0)], None) == (None, [False], None)
