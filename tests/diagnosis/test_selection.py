from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import Score, Selection, select

NAMES = ("viscous_friction", "coulomb_friction", "quadratic_drag", "constant_force", "armature_error")


@pytest.fixture(scope="module")
def selection(bench) -> Selection:
    return select(bench.shooting, [bench.effect(name) for name in NAMES], bench.nominal)


def test_the_injected_effect_alone_is_chosen(bench, selection) -> None:
    assert selection.best.keys == {("viscous_friction", "joint:hip")}
    assert selection.best.values[0][0] == pytest.approx(bench.viscous, rel=0.05)
    assert selection.ranked()[0] is selection.best
    assert len({fit.keys for fit in selection.ranked()}) == len(selection.ranked())


def test_rivals_and_the_nominal_were_compared(bench, selection) -> None:
    compared = {fit.keys for fit in selection.ranked()}
    assert frozenset() in compared
    assert frozenset({("quadratic_drag", "joint:hip")}) in compared
    assert selection.score(selection.best) + 20 < selection.score(bench.nominal)


def test_nothing_is_chosen_where_nothing_is_missing(clean) -> None:
    chosen = select(clean.shooting, [clean.effect(name) for name in NAMES], clean.nominal)
    assert chosen.best.effects == ()


def test_a_useless_set_to_begin_from_is_left_behind(bench) -> None:
    load = bench.effect("constant_force")
    effects = [bench.effect("viscous_friction"), load]
    chosen = select(bench.shooting, effects, bench.nominal, [((load,), (np.array([0.01]),))])
    assert chosen.best.keys == {("viscous_friction", "joint:hip")}
    assert frozenset({load.key}) in {fit.keys for fit in chosen.fits}


def test_a_name_and_a_parameter_have_their_price(bench) -> None:
    one, two = bench.effect("viscous_friction"), bench.effect("hysteresis")
    score = Score(samples=1000, names=30, scale=1.0)
    assert score.price([]) == 0.0
    assert score.price([one]) == pytest.approx(math.log(1000) + 2 * math.log(30))
    assert score.price([one, two]) == pytest.approx(3 * math.log(1000) + 4 * math.log(30))
    larger = dataclasses.replace(score, mismatch=1e6)
    assert larger.price([one]) > 100 * score.price([one])


def test_the_score_is_chi2_in_units_of_the_noise_and_the_price(bench) -> None:
    score = Score(samples=400, names=10, scale=2.0)
    assert score(bench.nominal) == pytest.approx(bench.nominal.chi2 / 2.0)
    fit = bench.fit("viscous_friction", 0.05)
    assert score(fit) == pytest.approx(fit.chi2 / 2.0 + score.price(fit.effects))
