from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.conftest import XML, assemble, swing
from torch_activegp.data import Recording
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.development import _proposals, expand
from torch_activegp.diagnosis.selection.more_axes import in_fewer_axes, in_more_axes
from torch_activegp.diagnosis.selection.polish import polish
from torch_activegp.diagnosis.selection.screening import Atom, Screen
from torch_activegp.diagnosis.selection.ties import ties_of
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.inertia import GravityError


def screened(names: str, normal: np.ndarray, gradient: np.ndarray) -> Screen:
    """A score test of gravity along some axes, one column each."""
    along = [GravityError.along("xyz".index(name)) for name in names]
    atoms = [
        Atom(effect, np.ones(1), float(gradient[i] ** 2 / normal[i, i]), slice(i, i + 1), effect.seeds[0])
        for i, effect in enumerate(along)
    ]
    return Screen(tuple(atoms), normal, gradient)


def told_by(clean, truth: Candidate) -> Shooting:
    """The likelihood of recordings of some truth with noise of 0.1 mrad."""
    own = clean.engine.predict(clean.segments, clean.nominal.starts[None], [truth])[0]
    noise = 1e-4 * np.random.default_rng(0).normal(size=own.shape)
    segments = dataclasses.replace(clean.segments, position=own + noise)
    return Shooting(clean.engine, segments, NoiseModel.white(np.array([1e-4])))


@pytest.mark.parametrize(("price", "least", "taken"), [(5.0, 20.0, True), (200.0, 20.0, False), (5.0, 60.0, False)])
def test_a_vector_is_tried_along_one_more_axis_where_that_is_worth_its_price(price, least, taken: bool) -> None:
    test = screened("zx", np.diag([1.0, 4.0]), np.array([20.0, 16.0]))  # gains of 400 and 64
    forms = [GravityError.along(0, 1), GravityError.along(0, 2), GravityError.along(1, 2)]
    found = in_more_axes(
        [[atom] for atom in test.atoms[: 2 if taken else 1]],
        test,
        forms,
        lambda gain, some: gain - price * sum(len(e.parameters) for e in some),
        least,
    )
    assert len(found) == taken  # x and z make the same one
    for (atom,) in found:
        assert atom.effect is forms[1]
        size = test.atoms[0].seed[0]
        np.testing.assert_allclose(atom.values, [4.0 * size, 20.0 * size])  # x, then z


@pytest.mark.parametrize(("gradient", "axes"), [(16.0, "xyz"), (4.0, "xz")])
def test_axes_are_added_one_by_one_while_each_is_worth_it(gradient: float, axes: str) -> None:
    """The mass of a wrist lay off along three: along two of them, two loads stood for the third."""
    test = screened("zxy", np.diag([1.0, 4.0, 4.0]), np.array([20.0, 18.0, gradient]))  # the last gains 64 or 4
    forms = [GravityError.along(0, 1), GravityError.along(0, 2), GravityError.along(1, 2), GravityError.along(0, 1, 2)]
    ((atom,),) = in_more_axes([[test.atoms[0]]], test, forms, lambda gain, _: gain, 20.0)
    assert atom.effect.variant == axes
    values = {"x": 4.5, "y": gradient / 4.0, "z": 20.0}
    np.testing.assert_allclose(atom.values / test.atoms[0].seed[0], [values[axis] for axis in axes])


def test_what_is_no_vector_stays_as_it_is(bench) -> None:
    effect = bench.effect("viscous_friction")
    atom = Atom(effect, np.ones(1), 1.0, slice(0, 1), effect.seeds[0])
    test = Screen((atom,), np.eye(1), np.ones(1))
    assert in_more_axes([[atom]], test, [dataclasses.replace(effect, variant="xy")], lambda gain, _: gain, 0.0) == []


def test_a_centre_of_mass_that_moved_along_two_axes_is_found_beside_another_effect(clean) -> None:
    friction = clean.effect("viscous_friction")
    along = {effect.variant: effect for effect in clean.effects if effect.name == "center_of_mass_offset"}
    truth = Candidate((friction, along["xz"]), (np.array([0.03]), np.array([0.01, 0.02])))
    shooting = told_by(clean, truth)
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    chosen = Selection(nominal, [nominal], Score(shooting.samples, 60, 1.0))
    expand(chosen, shooting, [friction, *along.values()], nominal)
    assert set(chosen.best.effects) == {friction, along["xz"]}


@pytest.mark.parametrize(("shared", "proposed"), [(0.0, False), (1.9, True)])
def test_a_vector_is_proposed_along_axes_that_gain_little_alone(bench, shared: float, proposed: bool) -> None:
    """Where it gains more along both than what gains most alone."""
    both, wet = GravityError.along(0, 2), bench.effect("viscous_friction")
    normal = np.array([[1.0, shared, 0.0], [shared, 4.0, 0.0], [0.0, 0.0, 1.0]])
    gradient = np.array([8.0, -16.0, 20.0])  # gains of 64, 64 and 400
    along = screened("zx", normal[:2, :2], gradient[:2])
    friction = Atom(wet, np.ones(1), 400.0, slice(2, 3), wet.seeds[0])
    test = Screen((*along.atoms, friction), normal, gradient)
    chosen = Selection(bench.nominal, [bench.nominal], Score(1000, 10, 1.0))
    sets = _proposals(chosen, bench.nominal, test, [both, *(atom.effect for atom in test.atoms)], 1)
    found = [values for effects, (values, *_) in sets if effects == (both,)]
    assert len(found) == proposed
    for values in found:
        together = np.linalg.solve(normal[:2, :2], gradient[:2])[::-1]
        np.testing.assert_allclose(values / along.atoms[0].seed[0], together)


@pytest.mark.parametrize(
    ("known", "shared", "left"),
    [((100.0, 1.0), 0.0, "x"), ((100.0, 100.0), 0.0, ""), ((1.0, 1.0), 0.0, "yx"), ((1e4, 1e4), 1e4 - 1e-3, "yx")],
)
def test_a_vector_is_tried_without_the_components_that_may_be_none(bench, known, shared, left) -> None:
    """The last: where either does what the other does, either may be none, though both together are not."""
    both, friction = GravityError.along(0, 1), bench.effect("viscous_friction")
    singles = [GravityError.along(axis) for axis in (0, 1, 2)]
    fit = dataclasses.replace(
        bench.fit("viscous_friction", 0.05),
        effects=(both, friction),
        values=(np.array([1.0, 2.0]), np.array([0.05])),
        information=np.diag([*known, 1.0]) + shared * np.eye(3)[[1, 0, 2]] * [1, 1, 0],
    )
    found = in_fewer_axes(fit, [both, *singles, friction])
    assert [effects for effects, _ in found] == [(friction, singles["xy".index(axis)]) for axis in left]
    assert [values[1].tolist() for _, values in found] == [[1.0 if axis == "x" else 2.0] for axis in left]
    unknown = dataclasses.replace(fit, information=np.zeros((0, 0))), dataclasses.replace(fit, at_rest=True)
    assert [in_fewer_axes(some, [both, *singles]) for some in unknown] == [[], []]


def test_a_vector_along_three_axes_is_tried_without_any_of_them(bench) -> None:
    every, forms = GravityError.along(0, 1, 2), [GravityError.along(0, 1), GravityError.along(0, 2)]
    fit = dataclasses.replace(
        bench.fit("viscous_friction", 0.05),
        effects=(every,),
        values=(np.array([1.0, 0.2, 0.1]),),
        information=np.diag([100.0, 100.0, 100.0]),
    )
    found = in_fewer_axes(fit, [every, *forms])
    assert [effects for effects, _ in found] == [(forms[1],), (forms[0],)]
    np.testing.assert_array_equal([values[0] for _, values in found], [[1.0, 0.1], [1.0, 0.2]])


def test_a_centre_of_mass_on_its_axis_ties_with_the_inertia_that_it_adds() -> None:
    """Along two axes a fit gets away from there, anywhere around it; along one, which has no slope there, none does."""
    xml = XML.replace('axis="0 1 0"', 'axis="0 0 1"').replace('diaginertia="0.08', 'diaginertia="0.001')
    xml = xml.replace("0.08 0.001", "0.001 0.001")
    run, kept = (Recording.from_columns(f"run{seed}", swing("none", seed)) for seed in (0, 9))
    upright = assemble("none", xml, [run], kept)
    rotor = upright.effect("armature_error")
    along = {effect.variant: effect for effect in upright.effects if effect.name == "center_of_mass_offset"}
    shooting = told_by(upright, Candidate((along["x"],), (np.array([0.05]),)))
    nominal = shooting.fit([((), ())], upright.nominal.starts)[0]
    sets = [((rotor,), (np.array([1e-3]),)), ((along["xy"],), (np.array([0.03, 0.02]),))]
    fits = shooting.fit(sets, nominal.starts)
    (stuck,) = shooting.fit([((along["x"],), (np.zeros(1),))], nominal.starts)
    assert stuck.chi2 > 10.0 * shooting.dof
    chosen = Selection(nominal, [nominal, *fits, stuck], Score(shooting.samples, 60, 1.0))
    polish(shooting, chosen, [rotor, *along.values()])
    ranked = [(fit, chosen.score(fit) - chosen.score(chosen.best), 0.0) for fit in chosen.ranked()]
    (effect,) = chosen.best.effects
    names = {effect.key, *ties_of(ranked, chosen.best, effect, (), ())}
    assert names == {("armature_error", "joint:hip"), ("center_of_mass_offset", "body:rod")}
