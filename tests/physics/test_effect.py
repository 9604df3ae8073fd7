from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics import Effect, Parameter, Place, Step
from torch_activegp.physics.actuation import ActuatorGain
from torch_activegp.physics.effect import element
from torch_activegp.physics.sensing import SensorBias


class Nothing(Effect):
    name = "nothing"
    law = "0"


NOTHING = Nothing("joint:elbow", (Parameter("size", "N m", 0.1), Parameter("width", "rad", 0.2)), np.zeros((1, 2)))


def test_an_effect_without_hooks_does_nothing(bench: Any) -> None:
    values = np.array([1.0, 2.0])
    np.testing.assert_array_equal(bench.hooks(NOTHING, values), bench.nominal())
    control = np.ones((1, 1, 5, 2))
    assert NOTHING.control(control, np.ones((1, 5)), values[None]) is None
    assert NOTHING.measure(lambda channel, delay: control, values[None]) is None
    assert not NOTHING.edit(lambda name: control, np.array([0]), values[None])
    assert NOTHING.memory(control, control, values[None]) is None
    assert not NOTHING.write(bench.spec, values)
    step = Step(control, control, control, np.zeros((1, 2)), lambda name: control, np.ones(1))
    NOTHING.before_step(step, np.array([0]), values[None], None)
    np.testing.assert_array_equal(step.force, 0.0)


def test_an_effect_is_made_at_a_place_where_its_class_says_how(bench: Any) -> None:
    with pytest.raises(NotImplementedError):
        Nothing.at(bench.elbow, bench.model)


def test_an_effect_is_told_by_name_and_target() -> None:
    assert NOTHING.key == ("nothing", "joint:elbow")
    assert NOTHING.describe(np.array([1.0, 2.0])) == {"size": 1.0, "width": 2.0}
    with pytest.raises(ValueError, match="argument 2 is shorter"):
        NOTHING.describe(np.array([1.0]))
    assert len({NOTHING, Nothing("joint:elbow", (), np.zeros((1, 0)))}) == 2
    assert Place("joint:left:elbow", 0).item == "left:elbow"


def test_what_a_drive_and_an_encoder_act_on_is_their_joint(bench: Any) -> None:
    spec = bench.spec
    tendon = spec.add_tendon(name="rope")
    tendon.wrap_joint("elbow", 0.5)
    spec.add_actuator(name="winch", target="rope", trntype=mujoco.mjtTrn.mjTRN_TENDON)
    model = spec.compile()
    winch = dataclasses.replace(bench.drive, target="actuator:winch", index=model.nu - 1)
    effects = [
        ActuatorGain.at(bench.drive, model),
        ActuatorGain.at(winch, model),
        SensorBias.at(dataclasses.replace(bench.drive, target="sensor:elbow"), model),
    ]
    assert [effect.acts_on for effect in effects] == ["joint:shoulder", "actuator:winch", "joint:elbow"]


def test_elements_are_found_by_name_or_number(bench: Any) -> None:
    spec = mujoco.MjSpec.from_string(
        bench.xml.replace('name="shoulder"', "").replace('joint="shoulder"', 'joint="elbow"')
    )
    assert element(spec, spec.joints, "joint:elbow").name == "elbow"
    assert element(spec, spec.joints, "joint:joint0").damping[0] == 0.05
    assert element(spec, spec.bodies, "body:fore").name == "fore"


@pytest.mark.parametrize(("place", "value", "step"), [(False, 8.0, 0.4), (False, 0.0, 0.005), (True, 8.0, 0.02)])
def test_a_small_change_goes_by_the_size_or_for_a_place_by_the_scale(place: bool, value: float, step: float) -> None:
    parameter = Parameter("periods", "1/turn", 0.1, high=8.01 if place else np.inf, place=place)
    assert abs(parameter.step(value)) == pytest.approx(step)
    assert (parameter.step(value) < 0) == place  # beyond the largest value
