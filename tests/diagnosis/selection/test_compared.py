from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.compared import Effort, Selection, compare, fitted, without_each
from torch_activegp.diagnosis.shooting.fit import resting
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.race import Race
from torch_activegp.diagnosis.shooting.score import Score


@pytest.fixture
def found(bench) -> Selection:
    return Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 20, 1.0))


@pytest.mark.parametrize("free", [False, True])
def test_beside_something_else_what_a_modeller_tunes_comes_first_of_what_nothing_tells_apart(bench, free) -> None:
    """Unless it is no name at all; alone, the better one comes first."""
    wave, spring, rotor = (bench.effect(name) for name in ("cogging", "linear_spring", "armature_error"))
    assert rotor.tunable and not (wave.tunable or spring.tunable)

    def first(rotors: tuple, springs: tuple, behind: float) -> bool:
        score = Score(samples=400, names=10, scale=1.0, free=frozenset({rotor.key}) if free else frozenset())
        price = [score.price(effects) for effects in (rotors, springs)]
        fits = [
            dataclasses.replace(
                bench.nominal, effects=effects, values=tuple(np.asarray(e.seeds[0]) for e in effects), chi2=chi2 - p
            )
            for effects, chi2, p in zip((rotors, springs), (900.0 + behind, 900.0), price, strict=True)
        ]
        selection = Selection(bench.nominal, fits, score)
        assert selection.ranked()[0] is selection.best
        return selection.best is fits[0]

    assert first((wave, rotor), (wave, spring), 0.1) is not free
    assert not first((wave, rotor), (wave, spring), 0.3)
    assert not first((rotor,), (spring,), 0.1)


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
    found.fits[-1] = resting((wet,), np.zeros(1), bench.nominal)
    again = fitted(bench.shooting, found, [wet])
    assert again.chi2 == pytest.approx(fit.chi2, rel=1e-3)
    assert not again.at_rest
    found.fits[-1] = fit
    assert fitted(bench.shooting, found, [wet]) is fit


def test_the_best_set_is_taken_apart(bench, found) -> None:
    wet, spring = bench.effect("viscous_friction"), bench.effect("cubic_spring")
    found.fits.clear()
    start = ((wet, spring), (np.array([0.05]), np.array([0.0])))
    found.add(bench.shooting.fit([start], bench.nominal.starts))
    parts = {effect.name: fit for effect, fit in without_each(found, bench.shooting, found.best.effects)}
    assert set(parts) == {"viscous_friction", "cubic_spring"}
    assert parts["viscous_friction"].chi2 > parts["cubic_spring"].chi2 + 100
    assert all(fit in found.fits for fit in parts.values())


def test_the_noise_is_what_the_best_fit_leaves(bench, found) -> None:
    found.rescale(bench.shooting.dof)
    assert found.score.scale == pytest.approx(bench.nominal.chi2 / bench.shooting.dof)
    assert found.score.mismatch == 0.0
    found.add([bench.fit("viscous_friction", 0.05), dataclasses.replace(bench.nominal, chi2=np.inf)])
    assert len(found.fits) == 2
    found.rescale(bench.shooting.dof)
    assert 1.0 <= found.score.scale < 1.3
    assert found.score.mismatch > 100


def test_parts_of_a_set_are_fitted_while_another_one_has_become_the_best(bench, found) -> None:
    whole = bench.fit("viscous_friction", 0.05)
    found.add([dataclasses.replace(whole, effects=(), values=(), chi2=0.5 * whole.chi2)])
    assert found.best.effects == ()
    part = fitted(bench.shooting, found, whole.effects, whole)
    assert part.chi2 == pytest.approx(whole.chi2, rel=1e-3)


def test_few_names_may_explain_as_much_as_many(bench, found) -> None:
    wet = bench.fit("viscous_friction", 0.05)
    names = [bench.effect(name) for name in ("viscous_friction", "cubic_spring", "constant_force")]
    many = dataclasses.replace(wet, effects=tuple(names), values=(np.ones(1),) * 3, chi2=wet.chi2 - 200.0)
    found.add([wet, many])
    assert found.best is many
    assert found.needs_more_than(2)
    for share, needed in ((0.004, False), (0.006, True)):
        found.fits[1] = dataclasses.replace(wet, chi2=many.chi2 + share * (bench.nominal.chi2 - many.chi2))
        assert found.needs_more_than(2) is needed
    named = found.score
    found.score = dataclasses.replace(named, free=frozenset(effect.key for effect in names))  # names cost nothing
    weak = found.score.a_parameter * (many.size - wet.size)  # nor is what more parameters gain anyway
    for gain, needed in ((0.9 * weak, False), (1.1 * weak, True)):
        found.fits[1] = dataclasses.replace(wet, chi2=many.chi2 + gain)
        found.nominal = dataclasses.replace(bench.nominal, chi2=many.chi2 + 5.0 * weak)
        assert found.needs_more_than(2) is needed
    found.fits[1], found.score = wet, named
    assert not Selection(bench.nominal, [bench.nominal], found.score).needs_more_than(2)


@pytest.mark.parametrize(
    ("effects", "size", "chi2", "expected"),
    [(1, 1, -3.0, True), (1, 1, -0.5, False), (1, 1, 1.0, False), (1, 2, -3.0, False), (2, 1, -3.0, False)],
)
def test_a_set_is_dominated_by_a_smaller_one_that_fits_better(bench, effects, size, chi2, expected) -> None:
    wet = bench.fit("viscous_friction", 0.05)
    pair = (bench.effect("viscous_friction"), bench.effect("constant_force"))
    best = dataclasses.replace(wet, effects=pair, values=(np.ones(1), np.zeros(1)), chi2=wet.chi2)
    values = (np.ones(size), *[np.ones(0)] * (effects - 1))
    small = dataclasses.replace(wet, effects=pair[:effects], values=values, chi2=wet.chi2 + chi2)
    assert Selection(bench.nominal, [bench.nominal, best, small], _First(best)).dominated is expected


class _First:
    """A score by which one fit is the best."""

    free: frozenset[tuple[str, str]] = frozenset()

    def __init__(self, fit) -> None:
        self.fit = fit

    def __call__(self, fit) -> float:
        return float(fit is not self.fit)


def test_what_got_stuck_is_fitted_once_more_from_what_it_contains(bench, found, monkeypatch) -> None:
    """Friction that sticks, far from its level, ends anywhere; no set hides behind the smaller one that it holds."""
    wet, spring = bench.effect("viscous_friction"), bench.effect("cubic_spring")
    start = ((wet, spring), (np.array([0.05]), np.array([0.0])))
    sound = bench.shooting.fit([start], bench.nominal.starts)[0]
    stuck = dataclasses.replace(sound, values=(np.array([3.0]), np.array([2.0])), chi2=2.0 * bench.nominal.chi2)
    found.add([bench.fit("viscous_friction", 0.05)])
    true, asked = type(bench.shooting).fit, []

    def fit(self, sets, *args, **kwargs):
        asked.append(list(sets))
        return [stuck] if len(asked) == 1 else true(self, sets, *args, **kwargs)

    monkeypatch.setattr(type(bench.shooting), "fit", fit)
    compare(bench.shooting, found, [(stuck.effects, stuck.values)], found.best)
    assert found.of(stuck.effects).chi2 == pytest.approx(sound.chi2, abs=0.5)
    [[(_, (drag, stiffness))]] = asked[1:]
    assert (drag[0], stiffness[0]) == (pytest.approx(found.best.values[0][0], rel=0.05), 0.0)


def test_what_is_far_from_the_best_is_not_fitted_once_more(bench, found, monkeypatch) -> None:
    wet, spring = bench.effect("viscous_friction"), bench.effect("cubic_spring")
    fit = bench.fit("viscous_friction", 0.05)
    found.add([fit, dataclasses.replace(bench.nominal, effects=(spring,), values=(np.zeros(1),))])
    stuck = dataclasses.replace(fit, effects=(spring, wet), values=(np.zeros(1), np.ones(1)), chi2=np.inf)
    asked = []

    def once(self, sets, *args, **kwargs):
        asked.append(sets)
        return [stuck]

    monkeypatch.setattr(type(bench.shooting), "fit", once)
    found.fits[1] = dataclasses.replace(fit, chi2=bench.nominal.chi2 - 1.0)
    found.fits.append(dataclasses.replace(fit, effects=(bench.effect("constant_force"),)))
    compare(bench.shooting, found, [(stuck.effects, stuck.values)], fit)
    assert len(asked) == 1
    assert found.within(stuck) is found.fits[1]
    assert found.within(fit) is None


@pytest.mark.parametrize(("above", "pays"), [(0.9, False), (1.1, True)])
def test_a_fit_that_leaves_less_than_a_name_costs_is_not_developed(bench, found, above, pays) -> None:
    """Beyond a tenth of the noise, for no closer is its level known."""
    dof = bench.shooting.dof
    found.score = dataclasses.replace(found.score, mismatch=3.0 * dof / 0.006)
    fit = dataclasses.replace(bench.fit("viscous_friction", 0.05), chi2=0.9 * dof + above * 3.0 * dof)
    assert found.score.cheapest == pytest.approx(3.0 * dof)
    assert found.may_pay(dataclasses.replace(bench.nominal, chi2=0.0), dof)  # its noise is not seen yet
    assert found.may_pay(fit, dof) == pays
    found.score = dataclasses.replace(found.score, free=frozenset({("viscous_friction", "joint:hip")}))
    assert found.may_pay(fit, dof)  # corrections of a tuning cost little


def test_derivatives_are_remembered_of_the_best_sets_alone(bench, found) -> None:
    wet = bench.fit("viscous_friction", 0.05)
    assert wet.design is not None and wet.columns is not None
    elsewhere = [dataclasses.replace(wet.effects[0], target=f"joint:{k}") for k in range(30)]
    worse = [dataclasses.replace(wet, effects=(e,), chi2=wet.chi2 + 100.0 * k) for k, e in enumerate(elsewhere, 1)]
    odd = [dataclasses.replace(wet, chi2=wet.chi2 + k) for k in range(1, 20)]  # the same set, worse
    found.add([wet, *odd, *worse])
    found.lighten()
    heavy = [fit for fit in found.fits if fit.columns is not None]
    assert found.best is wet
    assert heavy == [bench.nominal, wet, *worse[:7]]
    assert [fit.chi2 for fit in found.fits[-30:]] == [fit.chi2 for fit in worse]
    light = found.fits[-1]
    assert light.design is None and light.without_derivatives is light


def test_what_may_become_the_best_when_names_cost_again_stays_whole(bench, found) -> None:
    wet = bench.fit("viscous_friction", 0.05)
    free = [dataclasses.replace(wet.effects[0], target=f"joint:{k}") for k in range(20)]
    tuned = [
        dataclasses.replace(wet, effects=(wet.effects[0], e), values=(wet.values[0],) * 2, chi2=wet.chi2 - 10.0)
        for e in free
    ]
    found.score = dataclasses.replace(found.score, free=frozenset(e.key for e in free))
    found.add([wet, *tuned])
    found.lighten()
    assert found.best is not wet
    assert wet in found.fits


def test_what_is_compared_is_lightened(bench, found) -> None:
    wet = bench.effect("viscous_friction")
    sets = [((wet,), (np.array([value]),)) for value in np.linspace(0.01, 0.1, 16)]
    compare(bench.shooting, found, sets, bench.nominal)
    assert sum(fit.columns is not None for fit in found.fits if fit.effects) == 1


@pytest.mark.parametrize("race", [True, False])
def test_a_race_knows_what_names_cost(bench, found, monkeypatch, race: bool) -> None:
    """Beside a damping that leaves noise alone a stop is not worth the time, where there was much to explain."""
    found.nominal = dataclasses.replace(bench.nominal, chi2=300.0 * bench.nominal.chi2)
    found.fits = [found.nominal]
    damping, stop = bench.effect("viscous_friction"), bench.effect("joint_stop")
    sets = [((damping,), (np.array([0.05]),))]
    sets.append(((damping, stop), (np.array([0.05]), np.array([0.5, 50.0, 0.1]))))
    ended: list[int] = []
    give_up = Race.give_up

    def listen(self, problems, over, only_misled=False) -> None:
        before = {id(problem) for problem in problems if problem.finished}
        give_up(self, problems, over, only_misled)
        ended.extend(len(p.effects) for p in problems if p.finished and id(p) not in before)

    monkeypatch.setattr(Race, "give_up", listen)
    compare(bench.shooting, found, sets, bench.nominal, Effort(race=race))
    assert found.best.keys == {damping.key}
    assert ended == ([2] if race else [])


@pytest.mark.parametrize(("nominal", "free", "again"), [(1.0, False, True), (300.0, False, False), (300.0, True, True)])
def test_what_got_stuck_is_fitted_again_where_it_could_become_the_best(
    bench, found, monkeypatch, nominal: float, free: bool, again: bool
) -> None:
    damping, spring = bench.effect("viscous_friction"), bench.effect("cubic_spring")
    best = bench.fit("viscous_friction", 0.05)
    found.add([best])
    found.nominal = dataclasses.replace(bench.nominal, chi2=nominal * bench.nominal.chi2)
    found.score = dataclasses.replace(found.score, free=frozenset({damping.key} if free else ()))
    stuck = dataclasses.replace(
        best, effects=(damping, spring), values=(*best.values, np.array([0.3])), chi2=best.chi2 + 30.0
    )
    asked: list[int] = []
    fit = Shooting.fit

    def listen(self, sets, *arguments, **options):
        asked.append(len(sets))
        return [stuck, stuck] if len(asked) == 1 else fit(self, sets, *arguments, **options)

    monkeypatch.setattr(Shooting, "fit", listen)
    compare(bench.shooting, found, [(stuck.effects, stuck.values)] * 2, best)
    assert asked == [2, *([1] if again else [])]  # once for both
    found.add([resting(stuck.effects, np.zeros(2), best)])
    asked.clear()
    monkeypatch.setattr(Shooting, "fit", lambda *a, **k: asked.append(1) or [resting(stuck.effects, np.zeros(2), best)])
    found.fits = [one for one in found.fits if len(one.effects) < 2]
    compare(bench.shooting, found, [(stuck.effects, stuck.values)], best)
    assert asked == [1]  # what rests is left alone


def test_a_part_is_fitted_once_however_often_it_is_asked_for(bench, found) -> None:
    whole = bench.fit("viscous_friction", 0.05)
    both = dataclasses.replace(
        whole, effects=(*whole.effects, bench.effect("cubic_spring")), values=(*whole.values, np.zeros(1))
    )
    both = dataclasses.replace(both, per_segment=whole.per_segment - 1.0)  # whose states would be tried each time
    found.add([both])
    once = fitted(bench.shooting, found, whole.effects, both)
    work = bench.shooting.work
    assert fitted(bench.shooting, found, whole.effects, both) is once
    assert bench.shooting.work == work
    assert once not in found.fits  # it is no rival


def test_parts_of_another_likelihood_are_forgotten(bench, found) -> None:
    wet, push = bench.effect("viscous_friction"), bench.effect("constant_force")
    part, both = (wet,), ((wet, push), (np.array([0.05]), np.zeros(1)))
    fits = [bench.nominal, *bench.shooting.fit([both], bench.nominal.starts)]
    chosen = dataclasses.replace(found, fits=fits, parts={}, tunable_gains=({}, 0.0))
    one = fitted(bench.shooting, chosen, part)
    assert fitted(bench.shooting, chosen, part) is one
    other = dataclasses.replace(chosen)
    chosen.forget_parts()
    assert (chosen.parts, chosen.tunable_gains) == ({}, None)
    assert other.parts  # those of a copy stay
    louder = dataclasses.replace(bench.shooting, noise=NoiseModel.white(np.array([0.5 * bench.noise])))
    assert fitted(louder, chosen, part).chi2 > 2.0 * one.chi2


def test_what_a_set_holds_is_at_least_the_nominal(bench, found) -> None:
    wet, spring = bench.fit("viscous_friction", 0.05), bench.effect("cubic_spring")
    assert found.below(wet.effects) is bench.nominal
    found.add([wet])
    assert found.below(wet.effects) is bench.nominal
    assert found.below((*wet.effects, spring)) is wet
    assert found.below((spring,)) is bench.nominal


def test_the_best_set_is_simplified_once_by_one_score(bench, found) -> None:
    assert [found.was_simplified(), found.was_simplified()] == [False, True]
    found.score = dataclasses.replace(found.score, material=0.001)
    assert not found.was_simplified()
    found.add([bench.fit("viscous_friction", 0.05)])
    assert not found.was_simplified()
