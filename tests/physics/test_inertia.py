from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import mujoco.batch
import numpy as np
import pytest

from torch_activegp.physics import Place, catalogue
from torch_activegp.physics.inertia import (
    ArmatureError,
    CenterOfMassOffset,
    GravityError,
    axes_of_gravity,
    pulls_of_gravity,
)

SLIDE = """
<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="cart">
<joint name="x" type="slide" axis="1 0 0" armature="0.5"/><geom type="box" size=".2 .05 .1" mass="1"/></body>
</worldbody><actuator><motor name="drive" joint="x"/></actuator></mujoco>"""
FORE = Place("body:fore", 2)
CRANE = """
<mujoco><worldbody><body name="bridge" euler="0 0 90"><joint name="x" type="slide" axis="0 1 0"/>
<geom size=".1" mass="3"/><body name="hoist"><joint type="slide" axis="0 0 1"/><geom size=".1" mass="2"/>
<body name="load"><joint name="swing" axis="0 1 0"/><geom pos="0 0 -.5" size=".1" mass="1"/>
<body name="claw"><joint name="reach" type="slide" axis="0 0 1"/><geom size=".1" mass="0.5"/></body>
</body></body></body>
<body name="other"><joint name="turn"/><joint name="late" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>
</worldbody></mujoco>"""


def effects(model: mujoco.MjModel) -> list[tuple[Any, list[float]]]:
    return [
        (ArmatureError.at(Place("joint:shoulder", 0), model), [0.05]),
        (CenterOfMassOffset.along(FORE, 0.2, 0), [0.05]),
        (CenterOfMassOffset.along(FORE, 0.2, 2), [-0.03]),
        (CenterOfMassOffset.along(FORE, 0.2, 0, 2), [0.05, -0.03]),
        (GravityError.along(0), [0.7]),
        (GravityError.along(0, 1, 2), [0.7, 0.0, -0.5]),
    ]


@pytest.mark.parametrize("number", range(6))
def test_the_models_file_does_the_same(bench: Any, number: int) -> None:
    effect, values = effects(bench.model)[number]
    assert bench.gap(bench.hooks(effect, values), bench.written(effect, values)) < 2e-4


def test_a_rotor_counts_where_mujoco_takes_a_shortcut(bench: Any) -> None:
    machine = dataclasses.replace(bench, xml=SLIDE, start=(0.0,))
    assert machine.model.dof_simplenum[0]
    effect = ArmatureError.at(Place("joint:x", 0), machine.model)
    assert machine.gap(machine.hooks(effect, [0.3]), machine.written(effect, [0.3])) < 1e-9


def test_bounds_units_and_names(bench: Any) -> None:
    rotor = ArmatureError.at(Place("joint:shoulder", 0), bench.model)
    assert rotor.parameters[0].low == pytest.approx(-0.018)
    assert rotor.parameters[0].unit == "kg m2"
    slide = ArmatureError.at(dataclasses.replace(FORE, position_unit="m", index=0), bench.model)
    assert slide.parameters[0].unit == "kg"
    vector = GravityError.along(0, 1, 2)
    assert list(vector.describe(np.array([1.0, 2.0, 3.0]))) == ["change_x", "change_y", "change_z"]
    assert {GravityError.along(*axes).key for axes in ((0,), (1,), (2,), (0, 2))} == {("gravity_error", "world")}
    assert [GravityError.along(*axes).stands_in for axes in ((0,), (0, 2))] == [False, True]


def test_gravity_is_a_constant_force_on_slides_that_nothing_turns() -> None:
    pulls = pulls_of_gravity(mujoco.MjModel.from_xml_string(CRANE))
    assert pulls.keys() == {"joint:x", "joint:joint1"}
    floating = pulls_of_gravity(mujoco.MjModel.from_xml_string(CRANE.replace('"load"', '"load" gravcomp="1"')))
    np.testing.assert_allclose(floating["joint:x"], [-5.5, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(pulls["joint:x"], [-6.5, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(pulls["joint:joint1"], [0.0, 0.0, 3.5], atol=1e-9)
    tilted = GravityError.along(0, 2, pulls=pulls)
    assert tilted.push(np.array([0.1, -2.0]), "joint:x") == pytest.approx(-0.65)
    assert tilted.push(np.array([0.1, -2.0]), "joint:swing") == 0.0


def test_gravity_is_tried_along_axes_that_some_joint_feels(bench: Any) -> None:
    slide = mujoco.MjModel.from_xml_string(SLIDE)
    tried = {effect.variant for effect in catalogue(slide, [], [], []) if effect.name == "gravity_error"}
    assert tried == {"x"}
    assert axes_of_gravity(bench.model) == (0, 2)  # its joints turn about y
    assert axes_of_gravity(mujoco.MjModel.from_xml_string(CRANE)) == (0, 1, 2)
    still = SLIDE.replace('name="cart"', 'name="cart" gravcomp="1"')
    assert axes_of_gravity(mujoco.MjModel.from_xml_string(still)) == ()


def test_the_centre_on_two_axes_begins_where_it_is_on_one() -> None:
    one, two = CenterOfMassOffset.along(FORE, 0.2, 2), CenterOfMassOffset.along(FORE, 0.2, 0, 2)
    np.testing.assert_allclose(two.taking_over(one, np.array([0.02])), [0.0, 0.02])


@pytest.mark.parametrize("own", [0.0, 0.01])
def test_a_rotor_is_tuned_where_a_drive_is_or_where_the_model_has_one(own: float) -> None:
    xml = SLIDE.replace('armature="0.5"', f'armature="{own}"').replace('<motor name="drive" joint="x"/>', "")
    model = mujoco.MjModel.from_xml_string(xml)
    assert ArmatureError.at(Place("joint:x", 0), model).tunable is (own > 0.0)
