from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.score import Score
from torch_activegp.diagnosis.selection import Selection, fitted, select

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


def test_what_no_machine_can_have_is_not_chosen(bench) -> None:
    stribeck = bench.effect("stribeck_friction")
    wet = bench.fit("viscous_friction", 0.05)
    odd = dataclasses.replace(wet, effects=(stribeck,), values=(np.array([0.0, 0.3, 0.2]),), chi2=0.5 * wet.chi2)
    found = Selection(bench.nominal, [bench.nominal, odd, wet], Score(bench.shooting.samples, 20, 1.0))
    assert (odd.plausible, wet.plausible, bench.nominal.plausible) == (False, True, True)
    assert found.best is wet
    assert odd not in found.ranked()
    fair = dataclasses.replace(odd, values=(np.array([0.1, 0.3, 0.2]),))
    assert fair.plausible


def test_a_part_that_was_given_up_is_fitted_from_the_nominal(bench) -> None:
    """Else what gains much alone would look as if it gained nothing, and pass for an undone tuning."""
    wet = bench.effect("viscous_friction")
    fit = bench.fit("viscous_friction", 0.05)
    both = dataclasses.replace(fit, effects=(wet, bench.effect("cubic_spring")), values=(*fit.values, np.array([0.1])))
    given_up = dataclasses.replace(fit, chi2=3.0 * bench.nominal.chi2)
    found = Selection(bench.nominal, [bench.nominal, both, given_up], Score(bench.shooting.samples, 20, 1.0))
    again = fitted(bench.shooting, found, [wet])
    assert again.chi2 == pytest.approx(fit.chi2, rel=1e-3)
    found.fits[-1] = fit
    assert fitted(bench.shooting, found, [wet]) is fit
