from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.development import expand
from torch_activegp.diagnosis.selection.more_axes import in_more_axes
from torch_activegp.diagnosis.selection.screening import Atom, Screen
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


def test_what_is_no_vector_stays_as_it_is(bench) -> None:
    effect = bench.effect("viscous_friction")
    atom = Atom(effect, np.ones(1), 1.0, slice(0, 1), effect.seeds[0])
    test = Screen((atom,), np.eye(1), np.ones(1))
    assert in_more_axes([[atom]], test, [dataclasses.replace(effect, variant="xy")], lambda gain, _: gain, 0.0) == []


def test_a_centre_of_mass_that_moved_along_two_axes_is_found_beside_another_effect(clean) -> None:
    friction = clean.effect("viscous_friction")
    along = {effect.variant: effect for effect in clean.effects if effect.name == "center_of_mass_offset"}
    truth = Candidate((friction, along["xz"]), (np.array([0.03]), np.array([0.01, 0.02])))
    own = clean.engine.predict(clean.segments, clean.nominal.starts[None], [truth])[0]
    noise = 1e-4 * np.random.default_rng(0).normal(size=own.shape)
    segments = dataclasses.replace(clean.segments, position=own + noise)
    shooting = Shooting(clean.engine, segments, NoiseModel.white(np.array([1e-4])))
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    chosen = Selection(nominal, [nominal], Score(shooting.samples, 60, 1.0))
    expand(chosen, shooting, [friction, *along.values()], nominal)
    assert set(chosen.best.effects) == {friction, along["xz"]}
