from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics.actuation import ActuatorBias, ActuatorGain
from torch_activegp.physics.servo import ServoLaw, ServoSaturation

VALUES = {ActuatorGain: 0.3, ActuatorBias: 0.2, ServoSaturation: 0.6}


@pytest.fixture
def effect(bench: Any) -> ServoSaturation:
    return ServoSaturation.at(bench.servo, bench.model)


@pytest.mark.parametrize("limit", [0.3, 0.8])
def test_the_models_file_does_the_same(bench: Any, effect: ServoSaturation, limit: float) -> None:
    assert bench.gap(bench.hooks(effect, [limit]), bench.written(effect, [limit])) < 1e-9


def test_a_limit_of_the_force_is_another_law_than_one_of_the_command(bench: Any, effect: ServoSaturation) -> None:
    limited = bench.hooks(effect, [0.9])
    data = mujoco.MjData(bench.model)
    beyond = 0
    for state, control in zip(limited[:-1], bench.control[1:], strict=True):
        data.qpos[:], data.qvel[:], data.ctrl[:] = state[:2], state[2:], control
        mujoco.mj_forward(bench.model, data)
        law = effect.servo.force(state[1:2], state[3:4], control[1:2])
        np.testing.assert_allclose(law, data.actuator_force[1], atol=1e-12)
        added = effect.added(state[1:2], state[3:4], control[1:2], np.array([0.9]))
        np.testing.assert_allclose(law + added, np.clip(law, -0.9, 0.9), atol=1e-12)
        beyond += abs(data.actuator_force[1]) > 0.9
    assert 50 < beyond < 950


def test_a_narrower_limit_of_the_model_stays(bench: Any) -> None:
    narrow = dataclasses.replace(bench, xml=bench.xml.replace('kv=".2"', 'kv=".2" forcerange="-.2 3"'))
    spec, effect = narrow.spec, ServoSaturation.at(bench.servo, narrow.model)
    assert effect.write(spec, np.array([0.5]))
    np.testing.assert_allclose(spec.actuators[1].forcerange, [-0.2, 0.5])
    assert narrow.gap(narrow.hooks(effect, [0.5]), narrow.written(effect, [0.5])) < 1e-9


@pytest.mark.parametrize(
    ("drive", "servo"),
    [
        ('<motor name="servo" joint="elbow"/>', False),
        ('<velocity name="servo" joint="elbow" kv="2"/>', True),
        ('<position name="servo" joint="elbow" kp="5" timeconst="0.1"/>', False),
        ('<general name="servo" joint="elbow" gear="3" gainprm="2" biastype="affine" biasprm="1 -4 -1"/>', True),
    ],
)
def test_only_a_force_that_depends_on_the_motion_has_one(bench: Any, drive: str, servo: bool) -> None:
    text = bench.xml.replace('<position name="servo" joint="elbow" kp="5" kv=".2"/>', drive)
    model = mujoco.MjModel.from_xml_string(text)
    assert (ServoLaw.of(model, 1) is not None) == servo
    assert ServoSaturation.fits(bench.servo, model) == servo
    assert not ServoSaturation.fits(dataclasses.replace(bench.servo, servo_force=0.0), model)  # or rests
    if servo:
        law, data = ServoLaw.of(model, 1), mujoco.MjData(model)
        data.qpos[:], data.qvel[:], data.ctrl[:] = (0.1, 0.2), (0.3, -0.4), (0.0, 0.5)
        mujoco.mj_forward(model, data)
        assert law.force(0.2, -0.4, 0.5) == pytest.approx(data.actuator_force[1])


def test_a_geared_servo_is_limited_before_its_gear(bench: Any) -> None:
    geared = dataclasses.replace(bench, xml=bench.xml.replace('kv=".2"', 'kv=".2" gear="3"'))
    effect = ServoSaturation.at(bench.servo, geared.model)
    assert geared.gap(geared.hooks(effect, [0.4]), geared.written(effect, [0.4])) < 1e-9
    assert effect.acts_on == "joint:elbow"


def test_a_range_that_does_not_limit_is_none(bench: Any) -> None:
    text = bench.xml.replace('kv=".2"', 'kv=".2" forcelimited="false" forcerange="-.1 .1"')
    idle = dataclasses.replace(bench, xml=text)
    effect = ServoSaturation.at(bench.servo, idle.model)
    assert idle.gap(idle.hooks(effect, [0.5]), idle.written(effect, [0.5])) < 1e-9


def test_no_file_holds_an_empty_range(bench: Any) -> None:
    one_sided = dataclasses.replace(bench, xml=bench.xml.replace('kv=".2"', 'kv=".2" forcerange=".5 3"'))
    effect = ServoSaturation.at(bench.servo, one_sided.model)
    assert not effect.write(one_sided.spec, np.array([0.3]))


@pytest.mark.parametrize("kinds", list(itertools.combinations(VALUES, 2)))
def test_two_effects_on_one_servo_are_those_of_the_models_file(bench: Any, kinds: Any) -> None:
    """Whichever two: the simulation changes the command first, then the force, and the file holds what that does."""
    place, model, spec = bench.servo, bench.model, bench.spec
    pairs = [(kind.at(place, model), np.array([VALUES[kind]])) for kind in kinds]
    rows, control = np.array([0]), bench.control[None, None].copy()
    for effect, values in sorted(pairs, key=lambda pair: pair[0].order):
        effect.edit(lambda name: getattr(model, name)[None], rows, values[None])
        effect.control(control, np.full((1, len(bench.control)), 0.001), values[None])
        assert effect.write(spec, values)
    spec.compile()
    simulated = bench.run(model, control[0, 0])
    assert bench.gap(simulated, bench.run(mujoco.MjModel.from_xml_string(spec.to_xml()))) < 1e-6
