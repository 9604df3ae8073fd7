from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.polish import _again, _in_fewer_axes, _near, polish, shared
from torch_activegp.diagnosis.shooting.score import Score

MODULE = "torch_activegp.diagnosis.selection.polish"


def test_a_rival_also_begins_from_the_parameters_of_the_best_where_these_are_others(bench) -> None:
    friction, push = bench.effect("viscous_friction"), bench.effect("constant_force")
    best = bench.fit("viscous_friction", 0.06)
    start = ((friction, push), (np.array([0.05]), np.array([0.0])))
    (rival,) = bench.shooting.fit([start], best.starts)
    assert shared(rival, best) is None
    error = rival.information[0, 0] ** -0.5
    for sigmas, other in ((1.0, False), (5.0, True)):
        moved = dataclasses.replace(best, values=(rival.values[0] + sigmas * error,))
        found = shared(rival, moved)
        assert (found is not None) == other
    assert found == ((friction, push), (moved.values[0], rival.values[1]))


def test_a_rival_that_contains_a_law_of_the_best_also_begins_as_that(bench) -> None:
    """So that it never ends worse than what it contains; its shape stays."""
    level = bench.fit("coulomb_friction", 0.05)
    stribeck = bench.effect("stribeck_friction")
    much = {"values": (np.array([0.2, 0.4, 0.3]),), "information": 1e6 * np.eye(3)}
    found = shared(dataclasses.replace(level, effects=(stribeck,), **much), level)
    assert found is not None
    np.testing.assert_array_equal(found[1][0], [level.values[0][0], 0.0, 0.3])


def test_what_comes_on_top_of_the_best_set_is_not_fitted_again_for_what_it_may_be_short_of(bench) -> None:
    wet, (drag, push) = bench.fit("viscous_friction", 0.05), map(bench.effect, ("quadratic_drag", "constant_force"))
    held = {"values": (*wet.values, np.zeros(1)), "chi2": wet.chi2 + 50.0}
    more = dataclasses.replace(wet, effects=(*wet.effects, push), **held)
    other = dataclasses.replace(wet, effects=(drag, push), **held)
    found = Selection(bench.nominal, [bench.nominal, wet, more, other], Score(bench.shooting.samples, 5, 1.0))
    assert _near(found, wet, 0.0, 0.0) == []
    assert _near(found, wet, 0.0, 100.0) == [other]
    assert _near(found, wet, 100.0, 0.0) == [other, more]


@pytest.mark.parametrize(("cut_short", "lost"), [(False, True), (True, True), (True, False)])
def test_the_best_set_and_its_rivals_end_at_their_optimum(bench, monkeypatch, cut_short, lost) -> None:
    """Not its rivals where the search was cut short and much is left: nothing explains what is missing then."""
    monkeypatch.setattr(f"{MODULE}.NOISE_ALONE", 0.5 if lost else 1.1)
    friction, push = bench.effect("viscous_friction"), bench.effect("constant_force")
    optimum = bench.fit("viscous_friction", 0.05)
    starts = optimum.starts.copy()
    starts[2] += 0.002
    short = bench.shooting.fit([((friction,), (np.array([0.05]),))], starts, rounds=0)[0]
    values = (np.array([0.05]), np.array([0.0]))
    rival = bench.shooting.fit([((friction, push), values)], starts, rounds=0)[0]
    score = Score(bench.shooting.samples, 5, 1.0)
    chosen = Selection(bench.nominal, [bench.nominal, short, rival], score, cut_short)
    assert short.chi2 > optimum.chi2 + 20.0
    polish(bench.shooting, chosen, [friction, push])
    assert chosen.best.effects == (friction,)
    assert abs(chosen.best.chi2 - optimum.chi2) < 0.5
    again = chosen.of((friction, push))
    assert again is not None
    assert bool(again.chi2 <= chosen.best.chi2 + 0.5) is not (cut_short and lost)


@pytest.mark.parametrize(("creeps", "times"), [(0.0, 3), (1e-2, 1)])
def test_what_creeps_is_not_polished_over_and_over(bench, monkeypatch, creeps: float, times: int) -> None:
    """A tuned arm with 29 parameters gained 1 in 17000 each time, and so did its rivals."""
    friction = bench.effect("viscous_friction")
    fit, asked = bench.fit("viscous_friction", 0.05), []

    def chained(_, fit):
        asked.append(1)
        return dataclasses.replace(fit, chi2=fit.chi2 - min(len(asked), 3))

    monkeypatch.setattr(f"{MODULE}.chained", chained)
    monkeypatch.setattr(f"{MODULE}._CREEPS", creeps)
    monkeypatch.setattr(f"{MODULE}._POLISHES", 3)
    chosen = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 5, 1.0))
    polish(bench.shooting, chosen, [friction])
    assert len(asked) == times


@pytest.mark.parametrize("free", [True, False])
def test_one_name_is_fitted_in_place_of_two_of_which_one_seemed_to_undo_a_tuning(bench, free: bool) -> None:
    """Else the search itself has compared them."""
    dry, push = bench.effect("coulomb_friction"), bench.effect("constant_force")
    (both,) = bench.shooting.fit([((dry, push), (np.array([0.02]), np.array([0.005])))], bench.nominal.starts)
    score = Score(bench.shooting.samples, 60, 1.0, free=frozenset({push.key} if free else ()))
    chosen = Selection(bench.nominal, [bench.nominal, both], score)
    assert chosen.best is both
    polish(bench.shooting, chosen, bench.effects)
    two_sided = [fit for fit in chosen.fits if fit.keys == {("asymmetric_friction", "joint:hip")}]
    assert bool(two_sided) is free
    if free:
        assert two_sided[0].chi2 < 1.01 * both.chi2


def test_a_set_that_was_overtaken_is_shown_the_way_of_the_other(bench, monkeypatch) -> None:
    """However far behind it is then: nobody showed it the states by which the other one fell so far."""
    wet, drag = bench.fit("viscous_friction", 0.05), bench.effect("quadratic_drag")
    (rival,) = bench.shooting.fit([((drag,), (np.array([0.05]),))], wet.starts)
    near = dataclasses.replace(rival, chi2=wet.chi2 + 5.0)
    shown: list[tuple[str, str]] = []

    def again(precise, fit, best):
        shown.append((fit.effects[0].name, best.effects[0].name))
        return dataclasses.replace(fit, chi2=wet.chi2 - 50.0 if fit is near else wet.chi2 - 60.0)

    monkeypatch.setattr(f"{MODULE}._again", again)
    chosen = Selection(bench.nominal, [bench.nominal, wet, near], Score(bench.shooting.samples, 5, 1.0))
    polish(bench.shooting, chosen, [wet.effects[0], drag])
    assert shown[:2] == [("quadratic_drag", "viscous_friction"), ("viscous_friction", "quadratic_drag")]
    assert chosen.best.effects == wet.effects


def test_rivals_that_are_not_near_may_have_gone_astray(bench, monkeypatch) -> None:
    """Once: what is led back is near then, and overtakes the best set here."""
    wet, drag = bench.fit("viscous_friction", 0.05), bench.effect("quadratic_drag")
    (rival,) = bench.shooting.fit([((drag,), (np.array([0.05]),))], wet.starts)
    far = dataclasses.replace(rival, chi2=wet.chi2 + 1000.0)
    back = dataclasses.replace(rival, chi2=wet.chi2 - 50.0)
    asked: list[tuple[str, list[str], float]] = []

    def led_back(precise, best, rivals, nominal):
        asked.append((best.effects[0].name, [fit.effects[0].name for fit in rivals if fit.effects], nominal))
        return [back]

    monkeypatch.setattr(f"{MODULE}.led_back", led_back)
    chosen = Selection(bench.nominal, [bench.nominal, wet, far], Score(bench.shooting.samples, 5, 1.0))
    polish(bench.shooting, chosen, [wet.effects[0], drag])
    assert asked == [("viscous_friction", ["quadratic_drag"], bench.nominal.chi2)]
    assert chosen.best.effects == (drag,)


def test_a_rival_takes_the_states_of_the_best_where_these_are_better_and_its_own_derivatives_else(
    bench, monkeypatch
) -> None:
    wet, drag = bench.fit("viscous_friction", 0.05), bench.effect("quadratic_drag")
    (rival,) = bench.shooting.fit([((drag,), (np.array([0.03]),))], wet.starts, rounds=0)
    assert _again(bench.shooting, rival, wet).chi2 < rival.chi2 - 20.0  # fitted from where it is
    better = dataclasses.replace(rival, chi2=rival.chi2 - 5.0)
    monkeypatch.setattr(f"{MODULE}.borrowed", lambda shooting, fit, other: better)
    assert _again(bench.shooting, rival, wet) is better
    monkeypatch.setattr(f"{MODULE}.borrowed", lambda shooting, fit, other: fit)
    assert _again(bench.shooting, bench.nominal, wet).chi2 == bench.nominal.chi2  # no parameter to fit


@pytest.mark.parametrize(("known", "asked"), [(None, True), (0.0, False), (8.0, False), (10.0, True)])
def test_an_axis_less_is_tried_but_where_it_was_fitted_as_well(bench, monkeypatch, known, asked: bool) -> None:
    """`known` is what a fit of that left more, chi2."""
    wet, drag = bench.fit("viscous_friction", 0.05), bench.effect("quadratic_drag")
    less = ((drag,), (np.array([0.05]),))
    monkeypatch.setattr(f"{MODULE}.in_fewer_axes", lambda fit, effects: [less])
    fits = [bench.nominal, wet]
    if known is not None:
        fits.append(dataclasses.replace(wet, effects=(drag,), chi2=wet.chi2 + known))
    chosen = Selection(bench.nominal, fits, Score(bench.shooting.samples, 5, 1.0))
    assert _in_fewer_axes(chosen, [wet], bench.effects) == ([less] if asked else [])


def test_a_best_set_that_ends_where_no_machine_can_be_stays_as_it_was(bench, monkeypatch) -> None:
    two_waves = bench.effect("cogging").more
    assert two_waves is not None
    apart, alike = (np.array([0.1] * two_waves.linear + periods) for periods in ([8.0, 40.0], [8.0, 8.0]))
    assert two_waves.plausible(apart)
    assert not two_waves.plausible(alike)
    best = dataclasses.replace(bench.nominal, effects=(two_waves,), values=(apart,), chi2=0.5 * bench.nominal.chi2)
    monkeypatch.setattr(f"{MODULE}.chained", lambda _, fit: dataclasses.replace(best, values=(alike,), chi2=1.0))
    chosen = Selection(bench.nominal, [bench.nominal, best], Score(bench.shooting.samples, 5, 1.0), cut_short=True)
    polish(bench.shooting, chosen, bench.effects)
    assert chosen.best is best


def test_what_says_the_same_elsewhere_and_what_may_have_ended_short_is_looked_for_once(bench, monkeypatch) -> None:
    """The rounds that follow are for what the sets show each other."""
    fit, asked, reach, gains = bench.fit("viscous_friction", 0.05), [], [], iter((50.0, 100.0, 100.0))
    monkeypatch.setattr(f"{MODULE}.elsewhere", lambda best, effects: asked.append(best) or [])
    monkeypatch.setattr(f"{MODULE}._near", lambda selection, best, gained, stuck: reach.append(stuck) or [])
    monkeypatch.setattr(f"{MODULE}.chained", lambda _, fit: dataclasses.replace(fit, chi2=fit.chi2 - next(gains)))
    chosen = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 5, 1.0))
    polish(bench.shooting, chosen, list(fit.effects))
    assert len(asked) == 1
    assert len(reach) == 3
    assert reach[0] > 0.0
    assert reach[1:] == [0.0, 0.0]
