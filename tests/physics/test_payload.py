from __future__ import annotations

from typing import Any

import mujoco
import mujoco.batch
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from torch_activegp.physics import Place
from torch_activegp.physics.payload import DensityError, PayloadAlong, PayloadAside, PayloadMass

FORE = Place("body:fore", 2)
REACH = np.array([0.15, 0.0, 0.0])


def payload(model: mujoco.MjModel, offset: Any = (0.15, 0.0, 0.0)) -> PayloadMass:
    return PayloadMass.at(FORE, model, np.array(offset), "end")


def effects(model: mujoco.MjModel) -> list[tuple[Any, list[float]]]:
    return [
        (payload(model, (0.0, 0.0, 0.0)), [0.3]),
        (payload(model), [0.3]),
        (payload(model, (0.1, 0.05, -0.08)), [0.3]),
        (payload(model), [-0.1]),
        (DensityError.at(FORE, model), [0.2]),
        (PayloadAlong.towards(FORE, model, REACH), [0.3, 0.08]),
        (PayloadAside.within(FORE, model, REACH, (0, 2)), [0.3, 0.08, -0.05]),
    ]


@pytest.mark.parametrize("number", range(7))
def test_the_models_file_does_the_same(bench: Any, number: int) -> None:
    effect, values = effects(bench.model)[number]
    assert bench.gap(bench.hooks(effect, values), bench.written(effect, values)) < 2e-4


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


def test_another_form_begins_where_the_first_one_stands(bench: Any) -> None:
    center, end = payload(bench.model, (0.0, 0.0, 0.0)), payload(bench.model)
    along = PayloadAlong.towards(FORE, bench.model, REACH)
    np.testing.assert_allclose(along.taking_over(center, np.array([0.2])), [0.2, 0.075])
    np.testing.assert_allclose(along.taking_over(end, np.array([0.2])), [0.2, 0.15])
    aside = PayloadAside.within(FORE, bench.model, REACH, (0, 2))
    np.testing.assert_allclose(aside.taking_over(along, np.array([0.2, 0.1])), [0.2, 0.1, 0.0])
    np.testing.assert_allclose(along.taking_over(aside, np.array([0.2, 0.1, 0.03])), [0.2, 0.1])
    np.testing.assert_allclose(end.taking_over(along, np.array([0.2, 0.1])), [0.2])


def test_a_load_beside_the_body_is_one_at_that_point(bench: Any) -> None:
    aside, there = PayloadAside.within(FORE, bench.model, REACH, (0, 2)), payload(bench.model, (0.1, 0.0, -0.08))
    at = bench.hooks(there, [0.3])
    np.testing.assert_allclose(bench.hooks(aside, [0.3, 0.1, -0.08]), at, atol=1e-12)


def test_a_load_along_the_body_is_one_at_either_end_of_it(bench: Any) -> None:
    along = PayloadAlong.towards(FORE, bench.model, REACH)
    for offset in ((0.0, 0.0, 0.0), (0.15, 0.0, 0.0), (0.075, 0.0, 0.0)):
        at = bench.hooks(payload(bench.model, offset), [0.3])
        np.testing.assert_allclose(bench.hooks(along, [0.3, offset[0]]), at, atol=1e-12)


def test_a_load_may_sit_wherever_the_body_is_and_a_fifth_farther(bench: Any) -> None:
    """Also where its end is near its centre of mass, as that of a heavy ball on a thin rod."""
    aside = PayloadAside.within(FORE, bench.model, 0.01 * np.array(REACH), (0, 2))
    shapes = bench.model.geom_bodyid == FORE.index
    far = np.linalg.norm(bench.model.geom_pos[shapes] - bench.model.body_ipos[FORE.index], axis=1)
    far += bench.model.geom_rbound[shapes]
    assert [p.high for p in aside.parameters[1:]] == pytest.approx([1.2 * far.max()] * 2)
    assert 1.2 * far.max() > np.linalg.norm(REACH)


def test_the_law_of_a_load_says_where_it_is(bench: Any) -> None:
    said = [effect.law_with(np.array(values)) for effect, values in effects(bench.model)]
    places = [
        "(0, 0, 0)",
        "(0.15, 0, 0)",
        "(0.1, 0.05, -0.08)",
        "(0.15, 0, 0)",
        None,
        "(0.08, 0, 0)",
        "(0.08, 0, -0.05)",
    ]
    for words, place in zip(said, places, strict=True):
        assert place is None or f"at {place} m from the body's nominal centre of mass" in words
