from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.selection.merging import loads_beside, merged, push, pushes_alone, rests_of
from torch_activegp.physics import Place
from torch_activegp.physics.friction import AsymmetricCoulomb, CoulombFriction
from torch_activegp.physics.inertia import CenterOfMassOffset, GravityError, pulls_of_gravity
from torch_activegp.physics.payload import DensityError, PayloadAside, PayloadMass
from torch_activegp.physics.springs import CenteredSpring, CubicSpring, LinearSpring

BOX = """<mujoco><worldbody><body name="base"><joint/><geom size=".1" mass="1"/>
<body name="scoop" pos="1 0 0"><joint axis="0 1 0"/><geom type="box" size=".2 .1 .15" pos=".2 0 -.1" mass="30"/></body>
</body></worldbody></mujoco>"""
SCOOP = Place("body:scoop", 2)
REACH = np.array([0.2, 0.0, 0.15])
MODEL = mujoco.MjModel.from_xml_string(BOX)
PLANES = [PayloadAside.within(SCOOP, MODEL, REACH, plane) for plane in ((0, 1), (0, 2), (1, 2))]


def moments(*pairs) -> tuple[float, np.ndarray]:
    """Mass and centre of mass of the body with some effects."""
    names = ("body_mass", "body_ipos", "body_inertia", "body_iquat", "body_simple")
    fields = {name: getattr(MODEL, name)[None].copy() for name in names}
    for effect, values in pairs:
        effect.edit(fields.__getitem__, np.array([0]), np.array([values]))
    return fields["body_mass"][0, 2], fields["body_ipos"][0, 2]


@pytest.mark.parametrize(
    "load",
    [DensityError.at(SCOOP, MODEL), PayloadMass.at(SCOOP, MODEL), PayloadMass.at(SCOOP, MODEL, REACH, "end")],
)
def test_a_load_and_another_centre_are_a_load_elsewhere(load) -> None:
    """The excavator's bucket with soil in a corner: mass and centre of mass of the body stay as the two made them."""
    shift, other = CenterOfMassOffset.along(SCOOP, 0.3, 0, 2), DensityError.at(Place("body:base", 1), MODEL)
    pairs = [(load, np.array([1.2])), (other, np.array([0.1])), (shift, np.array([0.003, -0.002]))]
    [[kept, (form, values)]] = merged(pairs, [load, shift, other, *PLANES])
    assert kept == pairs[1]
    assert form is PLANES[1]
    mass, center = moments((form, values))
    expected_mass, expected_center = moments(pairs[0], pairs[2])
    assert mass == pytest.approx(expected_mass)
    np.testing.assert_allclose(center, expected_center, atol=1e-12)


def test_what_is_lighter_or_on_another_body_stays_two() -> None:
    load = DensityError.at(SCOOP, MODEL)
    here, base = (CenterOfMassOffset.along(place, 0.3, 0) for place in (SCOOP, Place("body:base", 1)))
    tried = [load, here, base, *PLANES]
    lighter, elsewhere = ([(load, np.array([m])), (e, np.array([0.01]))] for m, e in ((-1.0, here), (1.0, base)))
    assert merged(lighter, tried) == merged(elsewhere, tried) == []
    both = merged([(load, np.array([1.0])), (here, np.array([0.01]))], tried)
    assert [form for [(form, _)] in both] == PLANES[:2]


def test_a_load_stays_within_reach() -> None:
    load, shift = DensityError.at(SCOOP, MODEL), CenterOfMassOffset.along(SCOOP, 0.3, 0)
    for [(form, values)] in merged([(load, np.array([0.1])), (shift, np.array([0.2]))], PLANES):
        assert values[1] == form.parameters[1].high < 0.2 * 301


def test_an_offset_of_a_drive_is_a_push_through_its_gear(bench) -> None:
    constant, bias = bench.effect("constant_force"), bench.effect("actuator_bias", "actuator:drive")
    assert push(constant, np.array([0.3]), "joint:hip") == 0.3
    assert push(bias, np.array([0.3]), "joint:hip") == pytest.approx(0.3 * bias.nominal_gain * bias.gear)
    assert push(constant, np.array([0.3]), "joint:knee") == push(bias, np.array([0.3]), "joint:knee") == 0.0


def test_dry_friction_and_another_gravity_on_a_slide_are_a_friction_of_two_levels() -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="axis" type="slide" axis="1 0 0"/><geom size=".1" mass="4"/></body>
        </worldbody></mujoco>"""
    )
    place = Place("joint:axis", 0, position_unit="m", force_unit="N")
    dry, two_sided = (kind.at(place, model) for kind in (CoulombFriction, AsymmetricCoulomb))
    gravity = GravityError.along(0, pulls=pulls_of_gravity(model))
    level, tilt = np.array([2.0]), np.array([-0.1])
    found = merged([(dry, level), (gravity, tilt)], [dry, two_sided, gravity])
    assert [[effect for effect, _ in pairs] for pairs in found] == [[two_sided]]
    forces = [[float(two_sided.force(np.zeros(()), np.array(v), found[0][0][1])) for v in (-1.0, 1.0)]]
    assert forces == [pytest.approx([2.0 - 0.4, -2.0 - 0.4])]
    assert not merged([(dry, level), (GravityError.along(1, pulls=gravity.pulls), tilt)], [dry, two_sided])


def test_a_spring_and_a_constant_push_are_a_spring_that_rests_elsewhere(bench) -> None:
    at_zero, resting = (next(e for e in bench.effects if type(e) is kind) for kind in (CenteredSpring, LinearSpring))
    bias, cubic = (
        bench.effect("actuator_bias", "actuator:drive"),
        next(e for e in bench.effects if isinstance(e, CubicSpring)),
    )
    tried, wet = [at_zero, resting, cubic], bench.effect("viscous_friction")
    for constant in (bench.effect("constant_force"), bias):
        pairs = [(at_zero, np.array([2.0])), (wet, np.array([0.1])), (constant, np.array([0.6]))]
        [[kept, (form, values)]] = merged(pairs, tried)
        assert kept == pairs[1]
        assert form is resting
        assert form.describe(values) == pytest.approx({"stiffness": 2.0, "rest": 0.3})
        assert merged([(cubic, np.array([2.0])), pairs[2]], tried) == []
        assert merged(pairs[:2], tried) == []


def test_a_constant_push_says_where_a_spring_rests_that_holds_no_rest_itself(bench) -> None:
    at_zero, resting = (next(e for e in bench.effects if type(e) is kind) for kind in (CenteredSpring, LinearSpring))
    push, bias = bench.effect("constant_force"), bench.effect("actuator_bias", "actuator:drive")
    wet = bench.effect("viscous_friction")
    assert rests_of([wet, at_zero], [push, wet, bias]) == [push, bias]
    assert rests_of([resting, wet], [push, bias]) == []
    assert rests_of([dataclasses.replace(at_zero, target="joint:knee")], [push, bias]) == []


def test_another_centre_out_of_the_plane_of_a_load_is_a_load_anywhere() -> None:
    load, shift = PLANES[1], CenterOfMassOffset.along(SCOOP, 0.3, 1)
    anywhere = PayloadAside.within(SCOOP, MODEL, REACH, (0, 1, 2))
    pairs = [(load, np.array([1.2, 0.1, 0.05])), (shift, np.array([0.001]))]
    found = {form: values for [(form, values)] in merged(pairs, [*PLANES, anywhere])}
    mass, center = moments((anywhere, found[anywhere]))
    expected_mass, expected_center = moments(*pairs)
    assert mass == pytest.approx(expected_mass)
    np.testing.assert_allclose(center, expected_center, atol=1e-12)


def test_a_load_and_another_centre_may_be_a_load_on_the_body_before_or_after() -> None:
    """A tool aside of the last link of an arm stood at the end of the link before, with its centre of mass off."""
    own = '<joint axis="0 1 0"/><geom size=".04" mass="1" pos=".1 0 0"/>'
    names = ["base", "arm", "wrist", "hand"]  # each carries the next one, and the arm a camera too
    chain = "".join(f'<body name="{name}" pos="0 0 .2">{own}' for name in names)
    camera = f'<body name="camera" pos="0 0 .2">{own}</body>'
    xml = f"<mujoco><worldbody>{chain}</body></body>{camera}</body></body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    places = {model.body(i).name: Place(f"body:{model.body(i).name}", i) for i in range(1, model.nbody)}
    anywhere = {name: PayloadAside.within(place, model, REACH, (0, 1, 2)) for name, place in places.items()}
    plane = PayloadAside.within(places["hand"], model, REACH, (0, 1))
    forms = [*anywhere.values(), plane]
    load, shift = (
        PayloadMass.at(places["wrist"], model, REACH, "end"),
        CenterOfMassOffset.along(places["wrist"], 0.3, 2),
    )
    pairs = [(load, np.array([0.2])), (shift, np.array([0.01]))]
    found = {form: values for [(form, values)] in loads_beside(pairs, forms)}
    assert found.keys() == {anywhere["arm"], anywhere["hand"], plane}
    for form, values in found.items():
        np.testing.assert_array_equal(values, [0.2, *[0.0] * len(form.axes)])
    held = (CenterOfMassOffset.along(places["base"], 0.3, 0), np.array([0.02])), (plane, np.array([0.1, 0.0, 0.0]))
    [[*rest, (form, _)]] = loads_beside([*pairs, *held], forms)
    assert (rest, form) == (list(held), anywhere["arm"])  # the hand has one
    assert loads_beside([(load, np.array([-0.2])), pairs[1]], forms) == []  # what is missing is no load
    assert loads_beside(pairs[:1], forms) == []


def test_a_spring_that_hardly_stiffens_is_a_push(bench) -> None:
    wet, force = bench.effect("viscous_friction"), bench.effect("constant_force")
    bias = bench.effect("actuator_bias", "actuator:drive")
    spring = next(e for e in bench.effects if isinstance(e, LinearSpring))
    pairs = [(wet, np.array([0.1])), (spring, np.array([1e-5, 0.3]))]
    found = pushes_alone(pairs, [wet, force, bias, spring])
    assert [[e for e, _ in some] for some in found] == [[wet, force], [wet, bias]]
    assert all(push(*some[1], spring.target) == pytest.approx(0.3) for some in found)
    assert pushes_alone([*pairs, (force, np.array([0.1]))], [force]) == []
    assert pushes_alone(pairs[:1], [force]) == []
