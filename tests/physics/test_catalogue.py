"""What holds for every effect of the catalogue."""

from __future__ import annotations

import dataclasses
import pickle
import re
from collections import Counter
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.errors import ConfigurationError
from torch_activegp.physics import Effect, Place, catalogue
from torch_activegp.physics.actuation import ActuatorGain
from torch_activegp.physics.catalogue import body_effects, farthest_point
from torch_activegp.physics.drag import ViscousFriction
from torch_activegp.physics.joint import JointEffect
from torch_activegp.physics.sensing import SensorBias

NAMES = set(
    "viscous_friction coulomb_friction asymmetric_friction stribeck_friction quadratic_drag linear_spring cubic_spring "
    "constant_force cogging joint_stop payload_mass center_of_mass_offset armature_error gravity_error actuator_gain "
    "actuator_bias actuator_delay actuator_lag actuator_saturation actuator_dead_zone backlash hysteresis sensor_bias "
    "sensor_gain sensor_delay".split()
)
ABSENT = {"actuator_saturation": 100.0}  # where it is not zero


def effects(bench: Any) -> list[Effect]:
    sensors = [dataclasses.replace(place, index=c) for c, place in enumerate((bench.shoulder, bench.elbow))]
    return catalogue(bench.model, [bench.shoulder, bench.elbow], [bench.drive, bench.servo], sensors)


def every(test: Any) -> Any:
    """One test for each of the effects of the arm."""
    return pytest.mark.parametrize("number", range(97))(test)


def test_the_catalogue_holds_every_name(bench: Any) -> None:
    found = effects(bench)
    assert {effect.name for effect in found} == NAMES
    assert len(found) == 97
    assert max(Counter((*effect.key, effect.variant) for effect in found).values()) == 1
    targets = {effect.target.partition(":")[0] for effect in found}
    assert targets == {"joint", "actuator", "sensor", "body", "world"}


def test_the_page_names_every_effect_and_what_is_reported_of_it(bench: Any) -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "diagnosis.md").read_text(encoding="utf-8")
    table = page.partition("| effect | law |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| ([a-z_, ]+) \| .* \| (.*) \| .* \|$", table, re.MULTILINE)
    said = {name: set(re.findall(r"`([a-z_]+)`", words)) for names, words in rows for name in names.split(", ")}
    found: dict[str, set[str]] = {name: set() for name in NAMES}
    for effect in effects(bench):
        names = effect.describe(effect.seeds[0])
        found[effect.name] |= {re.sub(r"_[yz]$", "_x", name) for name in names if not name.endswith("_3")}
    for name, words in said.items():
        together = set().union(*(found[other] for other in said if said[other] == words))
        assert words == together, name
    assert set(said) == NAMES


def found_by_name(bench: Any, name: str, described: dict[str, float]) -> tuple[Effect, np.ndarray]:
    """The form of an effect whose parameters are described by some names, and values that say so."""
    for effect in effects(bench):
        values = effect.seeds[0].copy()
        if effect.name == name and set(described) <= set(effect.describe(values)):
            for i, key in enumerate(effect.describe(values)):
                values[i] = described.get(key, values[i])
            if name == "stribeck_friction":  # it is described by its static level, and fitted by the excess
                values[1] -= values[0]
            return effect, values
    raise AssertionError(f"no {name} with {sorted(described)}")


@pytest.mark.parametrize(
    ("name", "described", "too_much"),
    [
        ("viscous_friction", {"coefficient": -0.1}, True),
        ("viscous_friction", {"coefficient": 0.1}, False),
        ("coulomb_friction", {"level": -0.1}, True),
        ("quadratic_drag", {"coefficient": -0.1}, True),
        ("asymmetric_friction", {"positive": -0.1, "negative": -0.2}, True),
        ("asymmetric_friction", {"positive_level": -0.1, "negative_level": 0.2}, False),
        ("stribeck_friction", {"coulomb": -0.1, "static": 0.2}, False),
        ("stribeck_friction", {"coulomb": -0.2, "static": -0.1}, True),
        ("armature_error", {"armature": -0.1}, True),
        ("payload_mass", {"mass": -0.1}, True),
        ("payload_mass", {"mass": -0.1, "distance": 0.2}, True),
        ("payload_mass", {"mass": 0.1, "distance": -0.2}, False),
        ("actuator_bias", {"bias": -0.1}, False),
    ],
)
def test_a_loss_below_nothing_is_too_much_in_the_simulator(
    bench: Any, name: str, described: dict[str, float], too_much: bool
) -> None:
    effect, values = found_by_name(bench, name, described)
    assert {key: effect.describe(values)[key] for key in described} == pytest.approx(described)
    assert effect.too_much(values) is too_much


def test_what_may_be_too_much_is_described(bench: Any) -> None:
    """Every loss is the name of a parameter; otherwise nothing would be said."""
    for effect in effects(bench):
        assert effect.losses <= set(effect.describe(effect.seeds[0])), effect.key


def test_a_users_class_is_tried_wherever_it_can_act(bench: Any) -> None:
    kinds = {
        "joint": type("Rub", (ViscousFriction,), {"name": "rub"}),
        "actuator": type("Weak", (ActuatorGain,), {"name": "weak"}),
        "sensor": type("Off", (SensorBias,), {"name": "off"}),
    }
    sensors = [dataclasses.replace(place, index=c) for c, place in enumerate((bench.shoulder, bench.elbow))]
    found = catalogue(
        bench.model, [bench.shoulder, bench.elbow], [bench.drive, bench.servo], sensors, list(kinds.values())
    )
    assert len(found) == 97 + 6
    for where, kind in kinds.items():
        made = [effect for effect in found if type(effect) is kind]
        assert len({effect.target for effect in made}) == 2
        assert all(effect.target.startswith(f"{where}:") for effect in made)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ([ViscousFriction], "the name 'viscous_friction' of ViscousFriction is taken"),
        ([type("Rub", (ViscousFriction,), {"name": "rub"})] * 2, "the name 'rub' of Rub is taken"),
        ([type("Off", (SensorBias,), {})], "the name 'sensor_bias' of Off is taken"),
        ([type("Mine", (ViscousFriction,), {"name": "actuator_gain"})], "the name 'actuator_gain' of Mine is taken"),
        ([Effect], "a class wanted that is a JointEffect, an ActuatorEffect or a SensorEffect .* found .*Effect"),
        ([JointEffect], "has a name and a method `at`, found .*JointEffect"),
        ([type("Rub", (JointEffect,), {"name": "rub"})], "has a name and a method `at`, found .*Rub"),
        (["rub"], "a class wanted .* found 'rub'"),
    ],
)
def test_what_is_no_further_effect_is_refused(bench: Any, more: list[Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        catalogue(bench.model, [bench.elbow], [], [], more)


@pytest.mark.parametrize(
    ("at", "message"),
    [
        (classmethod(lambda cls, place: None), "cannot be called so: too many positional arguments"),
        (classmethod(lambda cls, place, model, size: None), "cannot be called so: missing a required argument: 'size'"),
        (3, "cannot be called so: 3 is not a callable object"),
        (lambda place, model: None, "a function without @classmethod"),
        (classmethod(lambda cls, place, model: None), "one that returns NoneType for joint:elbow"),
        (classmethod(lambda cls, place, model: cls), "one that returns type for joint:elbow"),
        (classmethod(lambda cls, place, model: ViscousFriction.at(place, model)), "one that returns ViscousFriction"),
    ],
)
def test_a_method_at_of_another_form_is_refused(bench: Any, at: Any, message: str) -> None:
    kind = type("Rub", (JointEffect,), {"name": "rub", "at": at})
    wanted = r"a class method Rub.at wanted that takes \(place, model\) and returns a Rub, found .*"
    with pytest.raises(ConfigurationError, match=rf"{wanted}{message}.*See tutorials/07"):
        catalogue(bench.model, [bench.elbow], [], [], [kind])


def test_an_error_inside_a_method_at_stays_what_it_is(bench: Any) -> None:
    kind = type("Rub", (JointEffect,), {"name": "rub", "at": classmethod(lambda cls, place, model: place.mass)})
    with pytest.raises(AttributeError, match="no attribute 'mass'"):
        catalogue(bench.model, [bench.elbow], [], [], [kind])


@every
def test_seeds_and_words_are_sound(bench: Any, number: int) -> None:
    effect = effects(bench)[number]
    low, high = np.array([(p.low, p.high) for p in effect.parameters]).T
    assert effect.seeds.shape[1:] == (len(effect.parameters),)
    assert ((effect.seeds >= low) & (effect.seeds <= high)).all()
    assert (low < high).all()
    assert all(p.scale > 0.0 and p.unit and p.name for p in effect.parameters)
    assert 0 <= effect.linear <= len(effect.parameters)
    assert (low[: effect.linear] <= 0.0).all()
    assert effect.law
    assert effect.law_with(effect.seeds[0])
    assert effect.__doc__
    described = [effect.describe(seed) for seed in effect.seeds]
    assert all(np.isfinite(list(words.values())).all() for words in described)
    assert pickle.loads(pickle.dumps(effect)).describe(effect.seeds[0]) == described[0]
    assert set(effect.covers) <= NAMES


@every
def test_an_absent_effect_changes_nothing(bench: Any, number: int) -> None:
    effect = effects(bench)[number]
    values = effect.absent(effect.seeds[-1]) + ABSENT.get(effect.name, 0.0)
    close = 5e-4 if "springy" in effect.variant else 4e-5  # as firm as time steps allow
    np.testing.assert_allclose(bench.hooks(effect, values)[:, :2], bench.nominal()[:, :2], atol=close)


@every
def test_a_present_effect_changes_something_and_its_file_agrees(bench: Any, number: int) -> None:
    effect = effects(bench)[number]
    if effect.target.startswith("sensor:"):
        pytest.skip("changes the recording, not the motion")
    values, spec = effect.seeds[-1], bench.spec
    changed = bench.hooks(effect, values)
    gap = np.abs(changed - bench.nominal())[:, :2].max()
    assert (gap > 1e-6) == (effect.variant != "y")  # which hinges about y do not feel
    if effect.write(spec, values):
        assert np.abs(bench.run(spec.compile()) - changed)[:, :2].max() < 0.2 * gap + 1e-6


def test_a_balanced_body_on_several_joints_gets_what_keeps_it_balanced() -> None:
    xml = """<mujoco><worldbody><body name="cart"><joint type="slide" axis="1 0 0"/><joint axis="0 1 0"/>
    <geom type="box" size=".2 .05 .1" mass="1"/></body></worldbody></mujoco>"""
    spec = mujoco.MjSpec.from_string(xml)
    assert [effect.variant for effect in body_effects(spec.compile())] == ["center", "density"]
    spec.body("cart").simple = False
    forms = [effect.variant for effect in body_effects(spec.compile())]
    planes = ["xy", "xz", "yz"]
    assert forms == ["center", "density", "end", "along", *planes, "xyz", "x", "y", "z", *planes, "xyz"]


def test_a_load_hangs_at_the_far_end(bench: Any) -> None:
    np.testing.assert_allclose(farthest_point(bench.model, 1), [0.0, 0.0, -0.2], atol=1e-9)
    np.testing.assert_allclose(farthest_point(bench.model, 2), [0.15, 0.0, 0.0], atol=1e-9)


def test_the_far_end_of_a_body_without_shapes_is_that_of_a_box_with_its_inertia() -> None:
    box = '<geom type="box" pos="0 0 1" size=".1 .2 .4" mass="3" euler="0 90 0"/>'
    shape = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><body><joint/>{box}</body></worldbody></mujoco>")
    inertia = " ".join(map(str, shape.body_inertia[1]))
    turn = " ".join(map(str, shape.body_iquat[1]))
    inertial = f'<inertial pos="0 0 1" mass="3" diaginertia="{inertia}" quat="{turn}"/>'
    bare = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody><body><joint/>{inertial}</body></worldbody></mujoco>")
    np.testing.assert_allclose(farthest_point(bare, 1), farthest_point(shape, 1), atol=1e-9)
    assert np.linalg.norm(farthest_point(bare, 1)) > 0.09


@pytest.mark.parametrize("turned", ["", 'quat=".6 .3 .2 .7"'])
def test_the_box_of_a_body_without_shapes_is_no_larger_than_the_machine(turned: str) -> None:
    """An inertia that stands for none; a site at the centre of mass says no more; of equal ends it is always one."""
    inertial = f'<inertial pos="0 0 0" mass=".001" diaginertia=".1 .1 .1" {turned}/><site/>'
    xml = f"""<mujoco><worldbody><body><joint/><geom size=".1" pos="0 0 .4"/>
    <body name="tool" pos="0 0 .5"><joint/>{inertial}</body></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    reach = farthest_point(model, 2)
    assert 0.0 < np.linalg.norm(reach) <= model.stat.extent + 1e-9
    assert reach.sum() > 0.0


def test_elements_without_a_name_go_by_their_number(bench: Any) -> None:
    xml = (
        bench.xml.replace('name="shoulder"', "")
        .replace('name="drive" joint="shoulder"', 'joint="elbow"')
        .replace('name="upper"', "")
    )
    model, spec = mujoco.MjModel.from_xml_string(xml), mujoco.MjSpec.from_string(xml)
    joint, drive = dataclasses.replace(bench.shoulder, target="joint:joint0"), Place("actuator:actuator0", 0)
    for effect in catalogue(model, [joint], [drive], []):
        effect.write(spec.copy(), effect.seeds[0])
    assert "body:body1" in {effect.target for effect in body_effects(model)}


@pytest.mark.parametrize(
    ("shape", "end"),
    [
        ('type="box" size=".2 .1 .15" pos=".2 0 -.12"', [0.2, 0.0, 0.0]),
        ('type="box" size=".1 .2 .15" pos=".2 0 0" euler="0 0 90"', [0.2, 0.0, 0.0]),
        ('type="ellipsoid" size=".1 .05 .3" pos="0 0 -.2"', [0.0, 0.0, -0.3]),
        ('type="capsule" size=".05 .2" pos="0 0 -.2"', [0.0, 0.0, -0.2]),
        ('type="sphere" size=".1" pos="0 0 -.2"', [0.0, 0.0, 0.0]),
    ],
)
def test_a_body_ends_where_its_shape_does(shape: str, end: list[float]) -> None:
    """The bucket of an excavator is a box: a load lies at its edge, not in its centre alone."""
    body = f'<body name="bucket"><joint axis="0 1 0"/><geom mass="3" {shape}/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    np.testing.assert_allclose(farthest_point(model, 1), end, atol=1e-9)
    forms = {effect.variant for effect in body_effects(model) if effect.name == "payload_mass"}
    assert ({"end", "along"} <= forms) == any(end)
    assert {"xy", "xz", "yz", "xyz"} <= forms  # a ball has room for a load aside


def test_a_load_aside_of_a_ball_is_no_farther_off_than_its_surface_and_a_little() -> None:
    """A tool aside of the ball that stood for a hand was no load of the hand."""
    body = '<body name="hand"><joint/><geom type="sphere" size=".1" mass="3" pos="0 0 -1"/></body>'
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{body}</worldbody></mujoco>")
    effects = {(effect.name, effect.variant): effect for effect in body_effects(model)}
    for parameter in effects["payload_mass", "xyz"].parameters[1:]:
        assert (parameter.low, parameter.high) == pytest.approx((-0.12, 0.12))
    assert effects["center_of_mass_offset", "x"].parameters[0].high == pytest.approx(0.02)
