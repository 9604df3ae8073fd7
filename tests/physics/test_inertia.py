from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import mujoco.batch
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from torch_activegp.physics import Place
from torch_activegp.physics.inertia import (
    ArmatureError,
    CenterOfMassOffset,
    DensityError,
    GravityError,
    PayloadAlong,
    PayloadMass,
)

SLIDE = """
<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="cart">
<joint name="x" type="slide" axis="1 0 0" armature="0.5"/><geom type="box" size=".2 .05 .1" mass="1"/></body>
</worldbody><actuator><motor name="drive" joint="x"/></actuator></mujoco>"""
FORE = Place("body:fore", 2)
BALANCED = """
<mujoco><option timestep="0.001"/><worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="turn" axis="0 1 0"/><geom type="box" size=".2 .05 .1" mass="1"/></body></worldbody></mujoco>"""


def payload(model: mujoco.MjModel, offset: Any = (0.15, 0.0, 0.0)) -> PayloadMass:
    return PayloadMass.at(FORE, model, np.array(offset), "end")


def effects(model: mujoco.MjModel) -> list[tuple[Any, list[float]]]:
    return [
        (ArmatureError.at(Place("joint:shoulder", 0), model), [0.05]),
        (payload(model, (0.0, 0.0, 0.0)), [0.3]),
        (payload(model), [0.3]),
        (payload(model, (0.1, 0.05, -0.08)), [0.3]),
        (payload(model), [-0.1]),
        (DensityError.at(FORE, model), [0.2]),
        (CenterOfMassOffset.along(FORE, 0.2, 0), [0.05]),
        (CenterOfMassOffset.along(FORE, 0.2, 2), [-0.03]),
        (GravityError.along(0), [0.7]),
        (GravityError.along(0, 1, 2), [0.7, 0.0, -0.5]),
        (PayloadAlong.at(FORE, model, (0.15, 0.0, 0.0)), [0.3, 0.08]),
        (CenterOfMassOffset.along(FORE, 0.2, 0, 2), [0.05, -0.03]),
    ]


@pytest.mark.parametrize("number", range(12))
def test_the_models_file_does_the_same(bench: Any, number: int) -> None:
    effect, values = effects(bench.model)[number]
    assert bench.gap(bench.hooks(effect, values), bench.written(effect, values)) < 2e-4


def test_a_rotor_counts_where_mujoco_takes_a_shortcut(bench: Any) -> None:
    machine = dataclasses.replace(bench, xml=SLIDE, start=(0.0,))
    assert machine.model.dof_simplenum[0]
    effect = ArmatureError.at(Place("joint:x", 0), machine.model)
    assert machine.gap(machine.hooks(effect, [0.3]), machine.written(effect, [0.3])) < 1e-9


@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (0.1, 0.05, -0.08)])
def test_a_payload_is_what_mujoco_makes_of_a_point_mass(bench: Any, offset: tuple[float, float, float]) -> None:
    effect, spec = payload(bench.model, offset), bench.spec
    body = spec.body("fore")
    place = bench.model.body_ipos[2] + np.array(offset)
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[1e-4, 0, 0], pos=place, mass=0.3, contype=0, conaffinity=0)
    assert bench.gap(bench.hooks(effect, [0.3]), bench.run(spec.compile())) < 1e-5
    written = bench.spec
    assert effect.write(written, np.array([0.3]))
    np.testing.assert_allclose(*map(tensor, (spec.compile(), written.compile())), atol=1e-8)


def tensor(model: mujoco.MjModel) -> np.ndarray:
    """The inertia of the forearm in its own axes."""
    axes = Rotation.from_quat(model.body_iquat[2], scalar_first=True).as_matrix()
    return np.asarray(axes @ np.diag(model.body_inertia[2]) @ axes.T)


def test_a_denser_body_is_what_mujoco_makes_of_it(bench: Any) -> None:
    denser = mujoco.MjModel.from_xml_string(bench.xml.replace('mass=".5"', 'mass=".7"'))
    effect = DensityError.at(FORE, bench.model)
    assert bench.gap(bench.hooks(effect, [0.2]), bench.run(denser)) < 1e-9


def test_a_missing_mass_leaves_some_inertia(bench: Any) -> None:
    for offset in ((0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (0.1, 0.05, -0.08)):
        effect, spec = payload(bench.model, offset), bench.spec
        assert -0.25 <= effect.parameters[0].low < 0.0
        assert effect.write(spec, np.array([effect.parameters[0].low]))
    spec = bench.spec
    assert payload(bench.model).write(spec, np.array([payload(bench.model).parameters[0].low]))
    assert (spec.compile().body_inertia[2] > 0.0).all()


@pytest.mark.parametrize("joints", ["one", "two"])
def test_a_balanced_body_can_lose_its_balance(joints: str) -> None:
    """Such bodies are compiled to a short cut, and a batch refuses to run on it once they are not balanced."""
    xml = BALANCED if joints == "two" else BALANCED.replace('<joint name="x" type="slide" axis="1 0 0"/>', "")
    spec = mujoco.MjSpec.from_string(xml)
    spec.body("cart").simple = joints == "one"
    model = spec.compile()
    effect = CenterOfMassOffset.along(Place("body:cart", 1), 0.2, 0)
    batch = mujoco.batch.Batch(model, 2, 1)
    effect.edit(batch.expand, np.array([1]), np.array([[0.1]]))
    batch.set_const(np.arange(2, dtype=np.int32))
    batch.step(None, 200)
    assert effect.write(spec, np.array([0.1]))
    data = mujoco.MjData(spec.compile())
    for _ in range(200):
        mujoco.mj_step(data.model, data)
    np.testing.assert_allclose(batch.bind("qpos")[1], data.qpos, rtol=1e-9)
    np.testing.assert_array_equal(batch.bind("qpos")[0], 0.0)
    assert (np.abs(data.qpos) > 1e-3).all()


@pytest.mark.parametrize("option", ["inertiafromgeom", "settotalmass", "fusestatic"])
def test_a_file_that_computes_its_own_inertia_cannot_hold_one(bench: Any, option: str) -> None:
    spec = bench.spec
    setattr(spec.compiler, option, 2.0 if option == "settotalmass" else 1)
    assert not payload(bench.model).write(spec, np.array([0.3]))
    assert not spec.body("fore").explicitinertial


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


def test_another_form_of_a_name_begins_where_the_first_one_stands(bench: Any) -> None:
    center, end = payload(bench.model, (0.0, 0.0, 0.0)), payload(bench.model)
    along = PayloadAlong.at(FORE, bench.model, (0.15, 0.0, 0.0))
    np.testing.assert_allclose(along.taking_over(center, np.array([0.2])), [0.2, 0.075])
    np.testing.assert_allclose(end.taking_over(along, np.array([0.2, 0.1])), [0.2])
    one, two = CenterOfMassOffset.along(FORE, 0.2, 2), CenterOfMassOffset.along(FORE, 0.2, 0, 2)
    np.testing.assert_allclose(two.taking_over(one, np.array([0.02])), [0.0, 0.02])


def test_a_load_along_the_body_is_one_at_either_end_of_it(bench: Any) -> None:
    along = PayloadAlong.at(FORE, bench.model, (0.15, 0.0, 0.0))
    for offset in ((0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (0.075, 0.0, 0.0)):
        at = bench.hooks(payload(bench.model, offset), [0.3])
        np.testing.assert_allclose(bench.hooks(along, [0.3, offset[0]]), at, atol=1e-12)
