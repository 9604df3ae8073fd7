from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import Selection, select

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
