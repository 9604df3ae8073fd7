from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.score import Score


def test_a_name_and_a_parameter_have_their_price(bench) -> None:
    one, two = bench.effect("viscous_friction"), bench.effect("hysteresis")
    score = Score(samples=1000, names=30, scale=1.0)
    assert score.price([]) == 0.0
    assert score.price([one]) == pytest.approx(math.log(1000) + 2 * math.log(30))
    assert score.price([one, two]) == pytest.approx(3 * math.log(1000) + 4 * math.log(30))
    larger = dataclasses.replace(score, mismatch=1e6)
    assert larger.price([one]) > 100 * score.price([one])


def test_further_components_of_a_vector_cost_no_more_than_corrections(bench) -> None:
    """A centre of mass that lies off along two axes is one thing; a law of two levels explains as much as two."""
    forms = {e.variant: e for e in bench.effects if e.key == ("center_of_mass_offset", "body:rod")}
    score = Score(samples=1000, names=30, scale=1.0, mismatch=1e6)
    assert score.price([forms["xz"]]) == pytest.approx(score.price([forms["z"]]) + math.log(1000))
    assert score.price([bench.effect("hysteresis")]) > 1.3 * score.price([forms["xz"]])


@pytest.mark.parametrize(
    ("scale", "mismatch", "each"),
    [
        (1.0, 1e5, 15.0),  # noise alone
        (1.0, 1e6, 1e-4 * 1e6),  # simulators differ by that
        (1.08, 5e5, 0.05 * 20_000 * (1 - 1 / 1.08)),  # a part of what is left above it
        (1.2, 1e6, 0.003 * 1e6 / 1.2),  # much is left: as any parameter
    ],
)
def test_near_the_noise_a_law_may_refine_the_one_it_contains(bench, scale: float, mismatch: float, each: float) -> None:
    """A static friction explains far less of a large mismatch than dry friction does, and shows clearly."""
    score = Score(samples=20_000, names=30, scale=scale, mismatch=mismatch)
    dry, more = bench.effect("coulomb_friction"), bench.effect("stribeck_friction")
    assert score.price([more]) == pytest.approx(score.price([dry]) + 2 * each)
    spring = bench.effect("hysteresis")  # contains no other law
    assert score.price([spring]) == pytest.approx(score.price([dry]) + 0.003 * mismatch / scale)
    small = dataclasses.replace(score, mismatch=0.0)
    assert small.price([more]) == pytest.approx(small.price([dry]) + 2 * math.log(20_000))  # as any parameter


@pytest.mark.parametrize(("scale", "first"), [(2.0, 6.0), (5.0, 20.0)])
def test_the_score_is_chi2_in_units_of_the_noise_and_the_price(bench, scale: float, first: float) -> None:
    """The first effect costs more, and most where what is left is no white noise of a known size."""
    score = Score(samples=400, names=10, scale=scale)
    assert score(bench.nominal) == pytest.approx(bench.nominal.chi2 / scale)
    fit = bench.fit("viscous_friction", 0.05)
    assert score(fit) == pytest.approx(fit.chi2 / scale + score.price(fit.effects) + first)


def test_what_seems_tuned_costs_its_parameters_alone(bench) -> None:
    score = Score(samples=1000, names=30, scale=1.0, mismatch=1e6)
    effects = [bench.effect("cubic_spring"), bench.effect("viscous_friction")]
    lenient = dataclasses.replace(score, free=frozenset({effects[1].key}))
    assert lenient.names_in(effects) == 1 < score.names_in(effects)
    assert lenient.price(effects) == pytest.approx(score.price(effects[:1]) + np.log(1000))


def test_where_all_hold_the_same_corrections_these_cost_nothing_and_all_else_the_same(bench) -> None:
    forms = {e.variant: e for e in bench.effects if e.key == ("center_of_mass_offset", "body:rod")}
    damping = bench.effect("viscous_friction")
    score = Score(samples=1000, names=30, scale=1.0, free=frozenset({damping.key}))
    alike = dataclasses.replace(score, corrected=True)
    assert alike.price([forms["xz"], damping]) == pytest.approx(score.price([forms["xz"]]))
    assert score.price([forms["xz"], damping]) == pytest.approx(score.price([forms["xz"]]) + math.log(1000))
    assert alike.without_free() == dataclasses.replace(score, free=frozenset())


def test_a_runaway_nominal_does_not_make_all_else_small(bench) -> None:
    effect = bench.effect("viscous_friction")
    adequate = Score(samples=1000, names=30, scale=1.0, mismatch=1e9)
    left = dataclasses.replace(adequate, scale=50.0)
    assert adequate.price([effect]) == pytest.approx(0.006 * 1e9)
    assert left.price([effect]) == pytest.approx(1000 / 3)
    assert dataclasses.replace(left, mismatch=1e7).price([effect]) == pytest.approx(1000 / 3)
    assert dataclasses.replace(left, mismatch=5e5).price([effect]) == pytest.approx(0.006 * 5e5 / 50)


@pytest.mark.parametrize(("scale", "more"), [(1.4, 0.0), (1.6, 20.0)])
def test_every_name_must_be_surer_where_what_is_left_may_be_a_colour_that_nobody_sees(bench, scale, more) -> None:
    effects = [bench.effect("cubic_spring"), bench.effect("viscous_friction")]
    seen = Score(samples=1000, names=30, scale=scale)
    unseen = dataclasses.replace(seen, hides_colour=True)
    assert unseen.price(effects) == pytest.approx(seen.price(effects) + 2 * more)
    assert unseen.cheapest == pytest.approx(seen.cheapest + more)


def test_corrections_that_all_have_cost_nothing(bench) -> None:
    wet, dear = bench.effect("viscous_friction"), bench.effect("cubic_spring")
    score = Score(1000, 60, 1.0, free=frozenset({wet.key}))
    whole = dataclasses.replace(score, corrected=True)
    assert score.price([wet, dear]) == pytest.approx(score.price([dear]) + score.a_parameter)
    assert whole.price([wet, dear]) == whole.price([dear]) == score.price([dear])
