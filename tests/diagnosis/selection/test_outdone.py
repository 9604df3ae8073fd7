from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.inertia import GravityError

SPRING = ("linear_spring", "joint:hip")


@pytest.fixture
def vector(bench):
    """Gravity along two axes."""
    gravity = GravityError.along(0, 2)
    return dataclasses.replace(bench.nominal, effects=(gravity,), values=(gravity.seeds[0],), chi2=5100.0)


@pytest.fixture
def law(bench):
    """A spring with a rest, which leaves 100 less and has a higher price."""
    spring = next(e for e in bench.effects if e.key == SPRING and len(e.parameters) == 2)
    return dataclasses.replace(bench.nominal, effects=(spring,), values=(spring.seeds[0],), chi2=5000.0)


def among(bench, *fits, scale: float = 1.0, free=frozenset()) -> Selection:
    nominal = dataclasses.replace(bench.nominal, chi2=1e5)
    return Selection(nominal, [nominal, *fits], Score(5000, 60, scale, mismatch=1e5, free=free))


def test_the_set_that_leaves_less_comes_before_one_that_a_vectors_price_favours(bench, vector, law) -> None:
    found = among(bench, vector, law)
    assert found.score(vector) < found.score(law)
    assert found.best is law
    assert vector not in found.ranked()
    assert vector in found.fits


def test_without_the_name_that_outdid_it_a_set_is_the_best_again(bench, vector, law) -> None:
    assert among(bench, vector, law).without(SPRING, 5000).best is vector


def test_a_set_without_a_vector_of_several_axes_is_not_outdone(bench, vector, law) -> None:
    """Prices of other laws are there for differences between simulators."""
    one = GravityError.along(2)
    short = dataclasses.replace(vector, effects=(one,), values=(one.seeds[0],))
    plain = dataclasses.replace(law, values=(law.values[0][:1],))
    assert among(bench, short, plain).best is short


def test_both_sets_may_have_the_vector(bench, vector, law) -> None:
    push, friction = bench.effect("constant_force"), bench.effect("coulomb_friction")
    both = [
        dataclasses.replace(vector, effects=(*vector.effects, e), values=(*vector.values, np.ones(1)), chi2=chi2)
        for e, chi2 in ((push, 5100.0), (friction, 5000.0))
    ]
    found = among(bench, *both)
    assert set(found.ranked()) >= set(both)


@pytest.mark.parametrize(
    "change",
    [
        {"chi2": 5085.0},
        {"at_rest": True},
        {"effects": "two"},
        {"values": "three"},
    ],
)
def test_a_set_is_not_outdone_by_hardly_less_or_more_names_or_parameters(bench, vector, law, change) -> None:
    other = dict(change)
    if "effects" in change:
        other |= {"effects": (*law.effects, bench.effect("viscous_friction")), "values": (np.ones(1), np.ones(1))}
    if "values" in change:
        other |= {"values": (np.ones(3),)}
    found = among(bench, vector, dataclasses.replace(law, **other))
    assert found.best is vector
    assert vector in found.ranked()


def test_noise_that_is_louder_and_what_fits_are_short_of_are_no_less(bench, vector, law) -> None:
    assert among(bench, vector, law, scale=6.0).best is vector
    vast = [dataclasses.replace(fit, chi2=fit.chi2 + 60_000.0) for fit in (vector, law)]
    assert among(bench, *vast).best is vast[0]


def test_parameters_that_undo_a_tuning_are_no_names(bench, vector, law) -> None:
    """A set with more of them has no room for a law of more parameters."""
    wet = bench.effect("viscous_friction")
    tuned = dataclasses.replace(vector, effects=(*vector.effects, wet), values=(*vector.values, np.ones(1)))
    longer = dataclasses.replace(law, values=(np.ones(3),))
    assert among(bench, tuned, longer, free=frozenset({wet.key})).best is tuned
    assert among(bench, tuned, law, free=frozenset({wet.key})).best is law
    beside = dataclasses.replace(law, effects=(*law.effects, wet), values=(*law.values, np.ones(1)))
    assert among(bench, vector, beside, free=frozenset({wet.key})).best is vector


def refined(bench, gained: float = 40.0, beside: float = 100.0, held: str = "viscous_friction"):
    """A damping, one that depends on the direction and gains a little more, and one with a push beside it."""
    damping, push = bench.effect("viscous_friction"), bench.effect("constant_force")
    law = next(e for e in bench.effects if e.key == ("asymmetric_friction", "joint:hip") and damping.name in e.covers)
    plain = dataclasses.replace(bench.nominal, effects=(damping,), values=(np.ones(1),), chi2=5000.0)
    finer = dataclasses.replace(plain, effects=(law,), values=(np.ones(2),), chi2=plain.chi2 - gained)
    two = dataclasses.replace(
        plain, effects=(bench.effect(held), push), values=(np.ones(1),) * 2, chi2=plain.chi2 - beside
    )
    return finer, among(bench, plain, finer, two)


def test_a_law_is_not_refined_where_what_is_left_has_another_place(bench) -> None:
    finer, found = refined(bench)
    assert found.score(finer) == min(map(found.score, found.fits))
    assert finer not in found.ranked()
    assert [e.name for e in found.best.effects] == ["viscous_friction"]


@pytest.mark.parametrize(
    "other",
    [
        {"beside": 50.0},
        {"held": "coulomb_friction"},
        {"gained": 700.0, "beside": 800.0},
    ],
)
def test_a_law_is_refined_where_that_gains_as_much_or_a_name(bench, other) -> None:
    finer, found = refined(bench, **other)
    assert found.best is finer


def test_a_law_stays_where_the_simpler_one_was_not_compared_or_more_stands_beside_it(bench) -> None:
    finer, found = refined(bench)
    plain, two = (next(fit for fit in found.fits if len(fit.effects) == n and fit is not finer) for n in (1, 2))
    assert among(bench, finer, two).best is finer
    drag = bench.effect("quadratic_drag")
    three = dataclasses.replace(two, effects=(*two.effects, drag), values=(np.ones(1), np.ones(0), np.ones(1)))
    assert three.size <= finer.size
    assert among(bench, plain, finer, three).best is finer
    larger = dataclasses.replace(two, values=(np.ones(1), np.ones(2)))
    assert among(bench, plain, finer, larger).best is finer
