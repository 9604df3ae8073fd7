from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import development as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.development import be_fair, expand, refine, simplify
from torch_activegp.diagnosis.selection.heats import Heat
from torch_activegp.diagnosis.selection.screening import screen
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score


@pytest.mark.parametrize(("much", "best"), [(1.0, ()), (0.0, ("viscous_friction",))])
def test_what_other_initial_states_alone_would_gain_is_no_effect(clean, monkeypatch, much, best) -> None:
    """The nominal's fit ended short of its optimum by more than a name costs; what gains much is not asked about."""
    monkeypatch.setattr(module, "_SOME", much)
    short = clean.nominal.starts.copy()
    short[3] += 0.002
    nominal = clean.shooting.fit([((), ())], short, rounds=0)[0]
    chosen = Selection(nominal, [nominal], Score(clean.shooting.samples, 5, 1.0))
    chosen.add([clean.fit("viscous_friction", 0.001)])
    assert chosen.best.effects
    be_fair(chosen, clean.shooting)
    assert tuple(effect.name for effect in chosen.best.effects) == best
    assert chosen.nominal in chosen.fits
    assert (chosen.nominal is nominal) is bool(best)
    if not best:
        assert chosen.nominal.chi2 == pytest.approx(clean.nominal.chi2, abs=1.0)


def test_a_name_less_is_fitted_again_from_the_states_of_a_best_set_that_gains_little(bench) -> None:
    """What a second name gains on an impact, other states may gain alone."""
    one, other = bench.effect("viscous_friction"), bench.effect("quadratic_drag")
    good = bench.fit("viscous_friction", bench.viscous)
    stuck = good.starts.copy()
    stuck[3] += 0.00078
    short = bench.shooting.fit([((one,), good.values)], stuck, rounds=0, hold=True)[0]
    both = bench.shooting.fit([((one, other), (*good.values, np.array([0.0])))], good.starts)[0]
    chosen = Selection(bench.nominal, [bench.nominal, short, both], Score(bench.shooting.samples, 5, 1.0))
    gain = short.chi2 - both.chi2
    assert 14.0 < gain < 0.05 * bench.shooting.dof
    assert chosen.best is both
    be_fair(chosen, bench.shooting)
    assert chosen.best.effects == (one,)
    assert chosen.best.chi2 < both.chi2 + 5.0
    assert chosen.of((other,)) is None  # what was not compared is not now
    once = Selection(bench.nominal, [bench.nominal, short, both], Score(bench.shooting.samples, 5, 1.0), beside=both)
    work = bench.shooting.work
    be_fair(once, bench.shooting)
    assert bench.shooting.work == work
    assert once.best is both


def test_gains_on_a_part_of_the_data_are_told_as_on_all_where_sets_are_proposed(bench, monkeypatch) -> None:
    fit, told = bench.fit("constant_force", 0.01), []
    part, which = bench.shooting.subset(0.5, fit.per_segment)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.development.seen_on", lambda *_: (part, fit.pick(which)))
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.development._proposals", lambda *args: told.append(args[2]) or []
    )
    selection = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 60, 1.0))
    wet = bench.effect("viscous_friction")
    expand(selection, bench.shooting, [wet], fit)
    (atom,) = screen(part, fit.pick(which), [wet]).best()
    assert told[0].best()[0].gain == pytest.approx(atom.gain * bench.segments.size / part.segments.size)


def test_sets_are_fitted_to_all_data_from_the_states_found_on_a_part(bench, monkeypatch) -> None:
    two, begun = (bench.effect("constant_force"), bench.effect("viscous_friction")), []
    (fit,) = bench.shooting.fit([(two, (np.array([0.01]), np.array([0.01])))], bench.nominal.starts)
    starts = np.stack([fit.starts + 0.1 * i for i in range(2)])
    some = [((bench.effect(name),), (np.array([0.02]),)) for name in ("viscous_friction", "quadratic_drag")]
    monkeypatch.setattr("torch_activegp.diagnosis.selection.development.heat", lambda *_: Heat(some, starts))
    monkeypatch.setattr(Shooting, "fit", lambda self, sets, begin, *_, **__: begun.append(begin) or [])
    selection = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 60, 1.0))
    expand(selection, bench.shooting, [bench.effect("quadratic_drag")], fit)
    simplify(selection, bench.shooting, bench.effects)
    assert len(begun) == 2  # what is better, and what is simpler
    for begin in begun:
        np.testing.assert_array_equal(begin, starts)


@pytest.mark.parametrize(("sets", "begun"), [(30, 30), (10, 10), (0, 6)])
def test_no_more_sets_are_begun_than_end_by_then(bench, monkeypatch, sets: int, begun: int) -> None:
    """The first of them; a few in any case."""
    wet = bench.effect("viscous_friction")
    proposed = [((wet,), (np.array([0.01 * i]),)) for i in range(30)]
    monkeypatch.setattr(module, "_proposals", lambda *_: proposed)
    passed: list = []
    monkeypatch.setattr(module, "heat", lambda shooting, some, *_: passed.extend(some) or Heat([], np.zeros(0)))
    chosen = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 60, 1.0))
    a_fit = 20.0 * bench.engine.steps_in(bench.segments)
    work = screening_of(bench, wet)
    expand(chosen, bench.shooting, [wet], bench.nominal, bench.shooting.work + work + (sets + 0.5) * a_fit)
    assert passed == proposed[:begun]


def screening_of(bench, effect) -> float:
    """Time steps of a score test."""
    before = bench.shooting.work
    screen(bench.shooting, bench.nominal, [effect])
    return bench.shooting.work - before


def test_what_is_simpler_ends_where_so_much_is_computed_in_all(bench, monkeypatch) -> None:
    two = (bench.effect("constant_force"), bench.effect("viscous_friction"))
    (fit,) = bench.shooting.fit([(two, (np.array([0.01]), np.array([0.01])))], bench.nominal.starts)
    chosen = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 60, 1.0))
    ends: list[float] = []
    monkeypatch.setattr(module, "compare", lambda *args, **_: ends.append(args[4].work))
    heated = module.heat
    monkeypatch.setattr(module, "heat", lambda *args: ends.append(args[4]) or heated(*args))
    simplify(chosen, bench.shooting, bench.effects, 7e6)
    assert ends == [7e6, 7e6]


@pytest.mark.parametrize(("scale", "known", "told"), [(1.0, False, True), (1.0, True, False), (1.2, False, False)])
def test_a_law_that_contains_that_of_the_best_set_is_tried_in_its_place(
    bench, monkeypatch, scale: float, known: bool, told: bool
) -> None:
    """Where noise alone is left nothing comes on top of it any more, and that may be missing yet."""
    fit = bench.fit("viscous_friction", bench.viscous)
    rich = next(e for e in bench.effects if "viscous_friction" in e.covers)
    other = dataclasses.replace(fit, effects=(rich,), values=(np.ones(2),), chi2=fit.chi2 + 1.0)
    fits = [bench.nominal, fit, *([other] if known else [])]
    chosen = Selection(bench.nominal, fits, Score(bench.shooting.samples, 60, scale))
    better = dataclasses.replace(other, chi2=fit.chi2 - 100.0)
    asked: list = []

    def compare(shooting, selection, sets, near, effort, below) -> None:
        asked.append((sets, near, effort.work, below))
        selection.add([better])

    monkeypatch.setattr(module, "compare", compare)
    assert refine(chosen, bench.shooting, bench.effects, 7e6) is told
    assert chosen.best is (better if told else fit)
    if told:
        ((sets, near, work, below),) = asked
        assert {effects for effects, _ in sets} == {(rich,)}
        assert near is below is fit
        assert work == 7e6


def test_new_sets_are_looked_at_behind_impacts(bench, monkeypatch) -> None:
    fits = [bench.fit(name, 0.02) for name in ("viscous_friction", "quadratic_drag")]
    chosen = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 60, 1.0))
    sets, asked = [(fit.effects, fit.values) for fit in fits], list[tuple]()
    monkeypatch.setattr(module, "compare", lambda *_, **__: None)
    monkeypatch.setattr(module, "_proposals", lambda *_: sets)
    monkeypatch.setattr(module, "heat", lambda *_: Heat(sets[:1], np.stack([bench.nominal.starts])))
    monkeypatch.setattr(module, "behind_impacts", lambda *args: asked.append(args))
    expand(chosen, bench.shooting, bench.effects, bench.nominal, 5e6)
    assert asked == [(chosen, bench.shooting, [frozenset(sets[0][0])], 5e6)]  # those that passed


@pytest.mark.parametrize(("fits", "begun"), [(0.0, 3), (4.5, 4), (np.inf, 5)])
def test_no_more_of_what_is_simpler_is_begun_than_ends_in_time(bench, monkeypatch, fits: float, begun: int) -> None:
    """The first three in any case: they come in order."""
    fit = bench.fit("viscous_friction", bench.viscous)
    chosen = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 60, 1.0))
    sets = [((effect,), (effect.seeds[0],)) for effect in bench.effects[:5]]
    compared: list = []
    monkeypatch.setattr(module, "simpler", lambda *_: list(sets))
    monkeypatch.setattr(module, "heat", lambda _, some, fit, *a: Heat(list(some), np.stack([fit.starts] * len(some))))
    monkeypatch.setattr(module, "compare", lambda *args, starts: compared.append((args[2], starts)))
    for name in ("forms_of_parts", "with_another_past"):
        monkeypatch.setattr(module, name, lambda *_: [])
    one = 20.0 * bench.engine.steps_in(bench.segments)
    simplify(chosen, bench.shooting, bench.effects, bench.shooting.work + fits * one)
    ((some, starts),) = compared
    assert list(some) == sets[:begun]
    assert len(starts) == begun


@pytest.mark.parametrize(
    ("astray", "held_well", "again"),
    [("one", True, True), ("none", True, False), ("all", True, False), ("one", False, False)],
)
def test_a_simpler_law_that_ended_far_off_is_fitted_from_the_best_set(
    bench, monkeypatch, astray: str, held_well: bool, again: bool
) -> None:
    """What was found on a part of the data led its fit to all of them astray: in one segment, not in all."""
    rich, plain = bench.effect("asymmetric_friction"), bench.effect("viscous_friction")
    good = bench.fit("viscous_friction", bench.viscous)
    values = np.array([0.99, 1.01]) * good.values[0]
    both = bench.shooting.fit([((rich,), (values,))], good.starts, rounds=1)[0]
    more = {"one": np.eye(len(good.per_segment))[0], "none": 0.0, "all": np.ones(len(good.per_segment))}[astray]
    per_segment = both.per_segment + 300.0 * np.asarray(more)
    ended = dataclasses.replace(good, per_segment=per_segment, chi2=per_segment.sum())
    chosen = Selection(bench.nominal, [bench.nominal, both], Score(bench.shooting.samples, 5, 1.0))
    compared: list[tuple] = []

    def compare(shooting, selection, sets, near, effort, starts) -> None:
        compared.append((sets, near, starts))
        selection.add([ended])

    monkeypatch.setattr(module, "compare", compare)
    monkeypatch.setattr(module, "heat", lambda shooting, sets, fit, score, work: Heat(list(sets), fit.starts[None]))
    if not held_well:
        monkeypatch.setattr(Shooting, "fit", lambda *_, **__: [dataclasses.replace(ended, chi2=2.0 * ended.chi2)])
    module.simplify(chosen, bench.shooting, bench.effects)
    assert len(compared) == 1 + again
    if again:
        (((effects, (value,)),), near, starts) = compared[-1]
        assert tuple(effects) == (plain,)
        assert near is both
        assert value == pytest.approx(both.values[0].mean())  # held as the best set has them
        np.testing.assert_allclose(starts[0], both.starts, atol=5e-3)


@pytest.mark.parametrize("goes", [False, True])
def test_forms_of_a_backlash_are_fitted_where_it_stays(bench, monkeypatch, goes: bool) -> None:
    """All eight without each of the others took a minute before the backlash itself went."""
    forms = {effect.variant: effect for effect in bench.effects if effect.name == "backlash"}
    play, wet = forms[""], bench.effect("viscous_friction")
    values = (np.array([0.02] * len(play.parameters)), np.array([0.05]))
    smaller = bench.fit("viscous_friction", 0.05)
    both = dataclasses.replace(
        smaller,
        effects=(play, wet),
        values=values,
        chi2=smaller.chi2 + (50.0 if goes else -900.0),
        information=1e6 * np.eye(len(play.parameters) + 1),
    )
    chosen = Selection(bench.nominal, [bench.nominal, both], Score(bench.shooting.samples, 5, 1.0))
    compared: list[frozenset] = []

    def compare(shooting, selection, sets, near, effort, starts) -> None:
        compared.extend(frozenset(effects) for effects, _ in sets)
        selection.add([smaller])

    monkeypatch.setattr(module, "compare", compare)
    monkeypatch.setattr(module, "heat", lambda shooting, sets, fit, score, work: Heat(list(sets), fit.starts[None]))
    monkeypatch.setattr(Selection, "best", property(lambda self: min(self.fits, key=lambda fit: fit.chi2)))
    module.simplify(chosen, bench.shooting, bench.effects)
    assert compared[:2] == [frozenset({wet}), frozenset({play})]
    assert bool({forms["resting"], wet} in compared) is not goes


@pytest.mark.parametrize(("scale", "asked"), [(1.05, False), (1.5, True)])
def test_bristles_are_fitted_for_as_many_names_only_where_more_than_noise_is_left(
    bench, monkeypatch, scale: float, asked: bool
) -> None:
    bristled = next(e for e in bench.effects if e.key == ("coulomb_friction", "joint:hip") and e.variant == "bristles")
    best, tried = bench.fit("coulomb_friction", 0.02), []
    monkeypatch.setattr(module, "heat", lambda _, sets, *a: tried.extend(sets) or Heat(sets, np.zeros((len(sets), 1))))
    monkeypatch.setattr(module, "compare", lambda *a, **k: None)
    selection = Selection(best, [best], Score(bench.shooting.samples, 60, scale))
    simplify(selection, bench.shooting, bench.effects)
    assert bool([some for some in tried if bristled in some[0]]) is asked
