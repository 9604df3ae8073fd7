from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import heats as module
from torch_activegp.diagnosis.selection.heats import Heat, heat, near, seen_on
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score

WET, LOAD = "viscous_friction", "constant_force"


@pytest.fixture
def sets(bench) -> list:
    return [((bench.effect(name),), (np.array([0.01]),)) for name in (WET, LOAD)]


def names(sets: list) -> list[str]:
    return [effects[0].name for effects, _ in sets]


@pytest.mark.parametrize(("mismatch", "passed"), [(1e5, [WET]), (10.0, [WET, LOAD])])
def test_what_gains_too_little_on_a_part_is_not_fitted_to_all(bench, sets, mismatch, passed) -> None:
    """But only where so much is missing that a part of the data shows it."""
    score = Score(bench.shooting.samples, 20, 1.0, mismatch=mismatch)
    found, starts = heat(bench.shooting, sets, bench.nominal, score)
    assert names(found) == passed
    moved = [abs(float(values[0][0]) - 0.01) > 1e-6 for _, values in found]
    assert moved == [mismatch > 100.0] * len(found)
    changed = (starts != bench.nominal.starts).any(axis=-1).mean(axis=-1)
    assert ((0.0 < changed) & (changed < 1.0) if mismatch > 100.0 else changed == 0.0).all()
    assert len(starts) == len(found)


@pytest.mark.parametrize(("mismatch", "tried"), [(4e4, True), (2e4, False)])
def test_on_most_of_the_data_nothing_is_tried_first(bench, sets, monkeypatch, mismatch: float, tried: bool) -> None:
    """It would save nothing: an effect must gain 240 or 120, of which a part shows 100 in the mean."""
    which = np.tile(np.arange(bench.segments.size), 9)
    many, nominal = bench.shooting.pick(which), bench.nominal.pick(which)
    asked: list[int] = []
    monkeypatch.setattr(
        module, "near", lambda part, *_: asked.append(part.segments.size) or Heat([], nominal.starts[None][:0])
    )
    heat(many, sets, nominal, Score(bench.shooting.samples, 20, 1.0, mismatch=mismatch))
    assert bool(asked) == tried


def test_fits_on_a_part_end_where_so_much_is_computed_in_all(bench, sets, monkeypatch) -> None:
    ends: list[float] = []
    fit = Shooting.fit
    monkeypatch.setattr(Shooting, "fit", lambda *args, **how: ends.append(how["work"]) or fit(*args, **how))
    score = Score(bench.shooting.samples, 20, 1.0, mismatch=1e5)
    heat(bench.shooting, sets, bench.nominal, score, 7e6)
    heat(bench.shooting, sets, bench.nominal, score)
    assert ends == [7e6, np.inf]


def test_what_costs_no_more_than_the_fit_passes(bench, sets) -> None:
    score = Score(bench.shooting.samples, 20, 1.0, mismatch=2e4)
    load = bench.fit(LOAD, 0.01)
    assert names(heat(bench.shooting, sets, load, score).sets) == [WET, LOAD]


def test_nearness_is_judged_by_the_part(bench, sets) -> None:
    part, which = bench.shooting.subset(0.5, bench.nominal.per_segment)
    for bars, passed in (([-20.0, -20.0], [WET]), ([20.0, 20.0], [WET, LOAD]), ([-1e9, 20.0], [LOAD])):
        assert names(near(part, which, sets, bench.nominal, bars).sets) == passed


def test_of_many_only_the_first_and_what_is_close_to_the_best_pass(bench) -> None:
    """By what they must gain: one that costs less may leave more."""
    part, which = bench.shooting.subset(0.5, bench.nominal.per_segment)
    names_ = (WET, LOAD, "cubic_spring", "linear_spring", "quadratic_drag")
    many = [((bench.effect(name),), (np.array([0.01]),)) for name in names_]
    chi2 = {name: fit.chi2 for name, fit in zip(names_, part.fit(many, bench.nominal.starts[which]), strict=True)}
    first, *_, last = sorted(chi2, key=chi2.__getitem__)
    found = names(near(part, which, many, bench.nominal, [1e3] * 5).sets)
    assert first in found
    assert len(found) == 3
    bars = [1e5 if name == last else 1e3 for name in names_]
    found = names(near(part, which, many, bench.nominal, bars).sets)
    assert {first, last} < set(found)
    assert len(found) == 3


@pytest.mark.parametrize(("behind", "passes"), [(50.0, True), (90.0, False)])
def test_a_fourth_one_passes_where_it_is_close_to_the_best(bench, monkeypatch, behind: float, passes: bool) -> None:
    part, which = bench.shooting.subset(0.5, bench.nominal.per_segment)
    names_ = (WET, LOAD, "cubic_spring", "linear_spring")
    many = [((bench.effect(name),), (np.array([0.01]),)) for name in names_]
    here = bench.nominal.pick(which)
    left = (100.0, 101.0, 102.0, 100.0 + behind)
    told = [
        dataclasses.replace(here, effects=some[0], values=some[1], chi2=chi2)
        for some, chi2 in zip(many, left, strict=True)
    ]
    monkeypatch.setattr(Shooting, "fit", lambda *_, **__: told)
    nominal = dataclasses.replace(bench.nominal, per_segment=np.full(len(bench.nominal.per_segment), 150.0))
    found = names(near(part, which, many, nominal, [0.0] * 4).sets)
    assert found == list(names_[: 3 + passes])


def test_a_set_that_began_from_several_first_guesses_is_one_of_the_first(bench) -> None:
    part, which = bench.shooting.subset(0.5, bench.nominal.per_segment)
    names_ = (WET, LOAD, "cubic_spring", "linear_spring", "quadratic_drag")
    many = [((bench.effect(name),), (np.array([0.01]),)) for name in names_]
    expected = names(near(part, which, many, bench.nominal, [1e3] * 5).sets)
    again = [((bench.effect(expected[0]),), (np.array([start]),)) for start in (0.02, 0.03)]
    assert names(near(part, which, [*many, *again], bench.nominal, [1e3] * 7).sets) == expected


@pytest.mark.parametrize(("times", "same"), [(1.009, True), (1.011, False)])
def test_a_set_passes_once_for_each_place_where_it_ended(bench, times: float, same: bool) -> None:
    """However small its values are, and in whatever order its effects."""
    wet, load = bench.effect(WET), bench.effect(LOAD)
    one = dataclasses.replace(bench.nominal, effects=(wet, load), values=(np.array([1e-9]), np.zeros(1)))
    other = dataclasses.replace(one, effects=(load, wet), values=(np.zeros(1), np.array([times * 1e-9])))
    assert module._same(one, other) is same
    assert not module._same(one, dataclasses.replace(one, effects=(wet,), values=one.values[:1]))


def test_what_passes_begins_from_the_states_found_on_the_part(bench, sets) -> None:
    part, which = bench.shooting.subset(0.5, bench.nominal.per_segment)
    found, starts = near(part, which, sets, bench.nominal, [20.0, 20.0])
    others = np.setdiff1d(np.arange(bench.segments.size), which)
    for (effects, values), states in zip(found, starts, strict=True):
        np.testing.assert_array_equal(states[others], bench.nominal.starts[others])
        there = part.fit([(effects, values)], states[which], rounds=0)[0]
        before = part.fit([(effects, values)], bench.nominal.starts[which], rounds=0)[0]
        assert there.chi2 < before.chi2


def test_what_is_worth_much_is_looked_for_on_a_part_with_the_worst_segments(bench) -> None:
    score = Score(bench.shooting.samples, 20, 1.0)
    assert seen_on(bench.shooting, bench.nominal, score) == (bench.shooting, bench.nominal)
    dear = dataclasses.replace(score, mismatch=1e6)
    assert seen_on(bench.shooting, bench.nominal, dear)[0] is bench.shooting
    fit = bench.fit("viscous_friction", 0.05)
    part, here = seen_on(bench.shooting, fit, dear)
    assert part.segments.size == len(here.per_segment) < bench.segments.size
    assert here.per_segment.max() == fit.per_segment.max()
    tuned = dataclasses.replace(dear, free=frozenset({("viscous_friction", "joint:hip")}))
    assert seen_on(bench.shooting, fit, tuned)[0] is bench.shooting


@pytest.mark.parametrize(("mismatch", "better"), [(10.0, True), (1e5, True), (10.0, False)])
def test_what_may_strike_is_sought_from_the_recording_where_a_fit_stands_out(
    bench, monkeypatch, mismatch: float, better: bool
) -> None:
    """There the states of a fit that strikes nothing lead nowhere; what it holds already stays as it is."""
    stop, wet = bench.effect("joint_stop"), bench.effect(WET)
    out = np.eye(len(bench.nominal.starts))[1]
    fit = dataclasses.replace(bench.fit(WET, bench.viscous), per_segment=1e6 * out)
    recorded = bench.engine.starts(bench.segments)[[1]]
    begun: list = []
    real = Shooting.fit

    def fitted(self, sets, starts, *rest, **how):
        begun.append((sets, starts, self.segments.size))
        if self.segments.size > 1:
            return real(self, sets, starts, *rest, **how)
        assert [effects for effects, _ in sets] == [(wet, stop)]
        values = np.array([7.0]), 2.0 * stop.seeds[0]
        found = fit.pick(np.array([1]))
        chi2 = 1.0 if better else 2e6
        return [dataclasses.replace(found, effects=(wet, stop), values=values, starts=recorded + 0.5, chi2=chi2)]

    monkeypatch.setattr(Shooting, "fit", fitted)
    drag = bench.effect("quadratic_drag")
    sets = [((wet, drag), (fit.values[0], np.array([0.01]))), ((wet, stop), (fit.values[0], stop.seeds[0]))]
    found = heat(bench.shooting, sets, fit, Score(bench.shooting.samples, 20, 1.0, mismatch=mismatch))
    np.testing.assert_array_equal(begun[0][1], recorded)
    first, starts = begun[1][:2] if mismatch > 100.0 else found
    place = 1 if mismatch < 100.0 else list(bench.shooting.subset(module.PART, fit.per_segment)[1]).index(1)
    assert first[0] == sets[0]
    np.testing.assert_array_equal(starts[0][place], fit.starts[1])
    np.testing.assert_array_equal(starts[1][place], recorded[0] + 0.5 if better else fit.starts[1])
    (effects, values) = first[1]
    assert tuple(effects) == (wet, stop)
    np.testing.assert_array_equal(values[0], fit.values[0])
    np.testing.assert_array_equal(values[1], 2.0 * stop.seeds[0] if better else stop.seeds[0])
    begun.clear()
    held = dataclasses.replace(fit, effects=(wet, stop), values=sets[1][1])  # whose states know of it
    heat(bench.shooting, sets[1:], held, Score(bench.shooting.samples, 20, 1.0))
    assert begun == []
