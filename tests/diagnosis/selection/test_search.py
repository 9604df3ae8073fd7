from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection import search as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.development import expand
from torch_activegp.diagnosis.selection.search import (
    Depth,
    _only_undoes,
    _seems_tuned,
    go_on,
    search,
    select,
)
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import linearize
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.effect import Effect

NAMES = ("viscous_friction", "coulomb_friction", "quadratic_drag", "constant_force", "armature_error")
FINE = 1e-4
_ROD = 'pos="0 0 -0.5" mass="1" diaginertia="0.08 0.08 0.001"'


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


def test_whatever_becomes_the_best_is_compared_fairly(bench, monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(module, "be_fair", lambda selection, _: asked.append(selection.best.keys))
    assert select(bench.shooting, [bench.effect(name) for name in NAMES], bench.nominal).best.keys in asked


def test_a_useless_set_to_begin_from_is_left_behind(bench) -> None:
    load = bench.effect("constant_force")
    effects = [bench.effect("viscous_friction"), load]
    chosen = select(bench.shooting, effects, bench.nominal, [((load,), (np.array([0.01]),))])
    assert chosen.best.keys == {("viscous_friction", "joint:hip")}
    assert frozenset({load.key}) in {fit.keys for fit in chosen.fits}


def test_a_fit_to_begin_from_is_taken_as_it_is(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    other = ((bench.effect("quadratic_drag"),), (np.array([0.01]),))
    chosen = select(bench.shooting, [*fit.effects, *other[0]], bench.nominal, [other], fit)
    assert chosen.fits[:2] == [bench.nominal, fit]
    assert [each.effects for each in chosen.fits].count(fit.effects) == 1
    assert other[0] in [each.effects for each in chosen.fits]


def test_a_fit_to_begin_from_that_failed_is_none(bench) -> None:
    fit = dataclasses.replace(bench.fit("viscous_friction", 0.05), chi2=np.inf, starts=bench.nominal.starts + np.inf)
    chosen = select(bench.shooting, list(fit.effects), bench.nominal, [(fit.effects, fit.values)], fit)
    assert chosen.best.keys == fit.keys
    assert fit not in chosen.fits


@pytest.mark.parametrize(("dt", "colour", "unseen"), [(0.01, 0.0, False), (0.02, 0.0, True), (0.02, 0.5, False)])
def test_a_colour_is_unseen_in_slow_recordings_unless_it_was_found(bench, dt, colour, unseen) -> None:
    segments = dataclasses.replace(bench.segments, dt=np.full_like(bench.segments.dt, dt))
    noise = dataclasses.replace(bench.shooting.noise, colour=np.full_like(bench.shooting.noise.colour, colour * 0.5))
    shooting = dataclasses.replace(bench.shooting, segments=segments, noise=noise)
    assert select(shooting, [], bench.nominal).score.hides_colour is unseen


def test_a_tuning_that_a_smaller_set_beats_is_none(bench, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", lambda *_: True)
    fit = bench.fit("viscous_friction", 0.05)
    pair = (bench.effect("cubic_spring"), bench.effect("viscous_friction"))
    best = dataclasses.replace(fit, effects=pair, values=(np.ones(1), fit.values[0]), chi2=fit.chi2 - 100.0)
    chosen = Selection(bench.nominal, [bench.nominal, best, fit], Score(bench.shooting.samples, 5, 1.0))
    chosen.score = dataclasses.replace(chosen.score, free=frozenset([pair[1].key]))
    chosen.fits += [dataclasses.replace(best, effects=pair[:1], values=best.values[:1], chi2=fit.chi2)]
    assert _only_undoes(chosen, bench.shooting)
    monkeypatch.setattr(Selection, "dominated", property(lambda self: True))
    assert not _only_undoes(chosen, bench.shooting)


def test_two_names_that_leave_most_are_no_end(bench) -> None:
    """As a part of the data may give them: nothing is added to them, and the search begins anew on all data."""
    astray = [bench.effect("payload_mass", "body:rod"), bench.effect("cubic_spring")]
    fits = bench.shooting.fit([(astray, (np.array([0.07]), np.array([0.2])))], bench.nominal.starts)
    selection = Selection(bench.nominal, [bench.nominal, *fits], Score(bench.shooting.samples, 60, 1.0))
    selection.rescale(bench.shooting.dof)
    effects = [bench.effect("viscous_friction"), *astray]
    done = {frozenset(some) for some in (astray, astray[:1], astray[1:])}
    selection.developed |= done
    search(selection, bench.shooting, effects, lambda words: None, Depth().counted_from(bench.shooting.work))
    assert selection.best.keys == {("viscous_friction", "joint:hip")}


@pytest.mark.parametrize("undoes", [True, False])
def test_what_only_undoes_a_tuning_frees_all_that_is_tunable(bench, monkeypatch, undoes: bool) -> None:
    """The drive's bias too, which no score had asked for yet; and nothing where the best set holds nothing tunable."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.search._only_undoes", lambda *_: undoes)
    score = Score(bench.shooting.samples, 60, 1.0)
    wet, dry = bench.fit("viscous_friction", 0.05), bench.fit("coulomb_friction", 0.01)
    selection = Selection(bench.nominal, [bench.nominal, wet], score)
    assert _seems_tuned(selection, bench.shooting, bench.effects) == undoes
    assert (("actuator_bias", "actuator:drive") in selection.score.free) == undoes
    assert undoes or selection.score == score
    assert not _seems_tuned(Selection(bench.nominal, [bench.nominal, dry], score), bench.shooting, bench.effects)


@pytest.mark.parametrize(("worse", "tuned"), [(6.0, True), (14.0, False)])
def test_a_tuning_may_stand_behind_names_of_which_none_is_tunable(bench, monkeypatch, worse, tuned) -> None:
    """A spring beside a damping that was tuned, for two others; not where they fit clearly worse."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.search._only_undoes", lambda *_: True)
    damping, spring = bench.effect("viscous_friction"), bench.effect("cubic_spring")
    others = bench.effect("payload_mass", "body:rod"), bench.effect("quadratic_drag")
    found = dataclasses.replace(bench.fit("viscous_friction", 0.05), effects=others, values=(np.ones(1),) * 2)
    behind = dataclasses.replace(found, effects=(spring, damping), chi2=found.chi2 + worse)
    selection = Selection(bench.nominal, [bench.nominal, found, behind], Score(bench.shooting.samples, 10_000, 1.0))
    assert selection.best is found
    assert _seems_tuned(selection, bench.shooting, bench.effects) == tuned
    assert selection.best is (behind if tuned else found)


@pytest.mark.parametrize("names", [("constant_force",), NAMES])
def test_soft_friction_is_tried_where_nothing_comes_close_to_the_noise(bench, monkeypatch, names) -> None:
    asked: list[float] = []
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.search.soften", lambda found, *_: asked.append(found.score.scale)
    )
    chosen = select(bench.shooting, [bench.effect(name) for name in names], bench.nominal)
    assert bool(asked) == chosen.score.inadequate == (names != NAMES)


def _recorded(xml: str, steps: int = 20, rows: int = 201) -> Recording:
    """A slow run at 100 Hz that MuJoCo integrates in steps of 0.5 ms."""
    model = mujoco.MjModel.from_xml_string(xml.replace('"0.005"', '"0.0005"'))
    data = mujoco.MjData(model)
    time = np.arange(rows) * steps * model.opt.timestep
    control = 0.6 * np.sin(2 * np.pi * 0.5 * time) + 0.3 * np.sin(2 * np.pi * 1.1 * time)
    angles = []
    for u in control:
        angles.append(data.qpos[0])
        data.ctrl[0] = u
        mujoco.mj_step(model, data, steps)
    noise = FINE * np.random.default_rng(5).normal(size=rows)
    return Recording.from_columns("slow", {"time": time, "qpos.hip": np.array(angles) + noise, "ctrl.drive": control})


def _nominal(bench, recording: Recording) -> tuple[Shooting, Fit]:
    """The likelihood of a recording without much noise, and the nominal's fit."""
    machine = make_machine(mujoco.MjModel.from_xml_string(bench.xml), [recording], [])
    segments = cut(machine.fit, 0.5, 0.1)
    shooting = Shooting(bench.engine, segments, NoiseModel.white(np.array([FINE])))
    return shooting, shooting.fit([((), ())], bench.engine.starts(segments))[0]


def test_friction_that_another_simulator_softens_is_fitted_in_its_own_form(bench) -> None:
    softened = bench.xml.replace('name="hip"', 'name="hip" frictionloss="0.3"')
    shooting, nominal = _nominal(bench, _recorded(softened, rows=401))
    dry = [effect for effect in bench.effects if effect.key == ("coulomb_friction", "joint:hip")]
    chosen = select(shooting, [*dry, bench.effect("viscous_friction")], nominal)
    assert chosen.best.keys == {dry[0].key}
    assert chosen.best.effects[0].variant == "soft"
    assert chosen.best.values[0][0] == pytest.approx(0.3, rel=0.02)
    firm = [
        fit for fit in chosen.fits if [effect.variant for effect in fit.effects] == [""] and fit.keys == {dry[0].key}
    ]
    assert min(fit.chi2 for fit in firm) > chosen.best.chi2 + 25


def test_a_mass_anywhere_along_its_body_is_one_name_where_two_others_would_do(bench) -> None:
    """Moment, centre and weight change by two numbers: a mass and a place, or any two of the three names."""
    place = 'pos="0 0 -0.5384615" mass="1.3" diaginertia="0.0864103 0.0864103 0.001"'  # 0.3 kg at 2/3 of the rod
    shooting, nominal = _nominal(bench, _recorded(bench.xml.replace(_ROD, place)))
    names = ("payload_mass", "center_of_mass_offset", "gravity_error", "linear_spring", "actuator_gain")
    effects = [effect for effect in bench.effects if effect.name in names]
    two = [next(e for e in effects if e.name == name) for name in names[1:3]]
    begun = [(two, [np.array([-0.01]), np.array([-1.0])])]
    for sets in ((), begun):
        assert select(shooting, effects, nominal, sets).best.keys == {("payload_mass", "body:rod")}


def test_a_search_ends_where_it_has_computed_enough(bench, monkeypatch) -> None:
    monkeypatch.setattr(module, "try_in_place", lambda *_: None)  # come on top
    effects, begun = [bench.effect(name) for name in NAMES], bench.shooting.work
    short = select(bench.shooting, effects, bench.nominal, depth=Depth(work=1.0))
    middle = bench.shooting.work
    linearize.cache_clear()
    whole = select(bench.shooting, effects, bench.nominal)
    assert (short.cut_short, whole.cut_short) == (True, False)
    assert short.best.keys == whole.best.keys == {("viscous_friction", "joint:hip")}
    assert whole.swapped == frozenset(whole.best.effects)
    assert 1.0 < middle - begun < 0.9 * (bench.shooting.work - middle)


@pytest.mark.parametrize(
    ("swapped", "developed", "noise_alone", "complete"),
    [(1, True, 1.1, True), (0, True, 1.1, False), (1, False, 1.1, False), (1, True, 0.1, False)],
)
def test_a_search_is_complete_where_nothing_would_be_tried_any_more(
    bench, monkeypatch, swapped: int, developed: bool, noise_alone: float, complete: bool
) -> None:
    """What could stand in place of the effect was tried, it took the rest of the work, and noise alone is left."""
    monkeypatch.setattr(module, "NOISE_ALONE", noise_alone)
    begin = bench.fit("viscous_friction", 0.05)
    fit = bench.shooting.fit([(begin.effects, begin.values)], begin.starts)[0]
    selection = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 60, 1.0))
    selection.swapped = frozenset(fit.effects[:swapped])
    selection.developed |= {frozenset(fit.effects)} if developed else set()
    assert module._is_complete(selection, bench.shooting, set()) is complete


@pytest.mark.parametrize("better", [True, False])
def test_laws_that_contain_those_of_the_best_set_come_before_others_in_its_place(bench, monkeypatch, better) -> None:
    begun: list[str] = []
    monkeypatch.setattr(module, "refine", lambda *args: begun.append(f"refine {args[3]:g}") or better)
    monkeypatch.setattr(module, "_swapped", lambda *_: iter([begun.append("swap") or True]))
    chosen = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 60, 1.0))
    tell, depth = (lambda words: None), Depth(work=1e6, more=5e5)
    next(module._resorts(chosen, bench.shooting, bench.effects, tell, depth, lambda: False))
    assert begun == ["refine 1.5e+06", *([] if better else ["swap"])]


@pytest.mark.parametrize("within", [True, False])
def test_others_were_tried_in_place_of_an_effect_where_that_ended_within_its_work(bench, monkeypatch, within) -> None:
    begin = bench.fit("viscous_friction", 0.05)
    fit = bench.shooting.fit([(begin.effects, begin.values)], begin.starts)[0]
    monkeypatch.setattr(module, "swap", lambda *_: None)
    selection = Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 60, 1.0))
    depth = Depth(work=bench.shooting.work + (0.0 if within else -1.0), more=0.0)
    list(module._swapped(selection, bench.shooting, bench.effects, lambda words: None, depth))
    assert (selection.swapped == frozenset(fit.effects)) is within


def test_what_is_simplified_last_counts_for_what_is_complete(bench, monkeypatch) -> None:
    two = bench.fit("asymmetric_friction", 0.06, 0.06)
    selection = Selection(bench.nominal, [bench.nominal, two], Score(bench.shooting.samples, 60, 1.0))
    judged: list[tuple[str, ...]] = []

    def is_complete(selection: Selection, *_: object) -> bool:
        judged.append(tuple(effect.name for effect in selection.best.effects))
        return False

    monkeypatch.setattr(module, "_is_complete", is_complete)
    search(selection, bench.shooting, bench.effects, lambda words: None, Depth(work=0.0))
    assert judged == [("viscous_friction",)]


def test_a_search_that_ends_there_simplifies_what_it_found_last(bench, monkeypatch) -> None:
    """A friction of two levels that are the same stood for one: it had come in a swap, after which nothing was done."""
    two = bench.fit("asymmetric_friction", 0.06, 0.06)
    selection = Selection(bench.nominal, [bench.nominal, two], Score(bench.shooting.samples, 60, 1.0))
    search(selection, bench.shooting, bench.effects, lambda words: None, Depth(work=0.0))
    assert selection.cut_short
    assert selection.best.keys == {("viscous_friction", "joint:hip")}


@pytest.mark.parametrize(("much", "developed"), [(1e9, 1), (0.0, 2)])
def test_of_the_best_two_sets_the_second_is_not_developed_after_that(bench, monkeypatch, much, developed) -> None:
    seen: list[Fit] = []

    def expand(selection: Selection, shooting: Shooting, effects: object, fit: Fit, work: float) -> None:
        seen.append(fit)
        monkeypatch.setattr(shooting.engine, "work", shooting.engine.work + much)

    monkeypatch.setattr("torch_activegp.diagnosis.selection.search.expand", expand)
    monkeypatch.setattr(Selection, "may_pay", lambda *_: True)
    wet = bench.fit("viscous_friction", 0.05)
    near = dataclasses.replace(bench.fit("quadratic_drag", 0.05), chi2=wet.chi2 + 1.0)
    selection = Selection(bench.nominal, [bench.nominal, wet, near], Score(bench.shooting.samples, 60, 2.0))
    monkeypatch.setattr(Selection, "rescale", lambda *_: None)
    search(selection, bench.shooting, [], lambda words: None, Depth(1, 0).counted_from(bench.shooting.work))
    assert len(seen) == developed


@pytest.mark.parametrize(("scale", "developed"), [(1.0, 0), (1.5, 1)])
def test_what_costs_more_than_a_best_that_leaves_noise_alone_is_not_developed(
    bench, monkeypatch, scale: float, developed: int
) -> None:
    wet, dear = bench.fit("viscous_friction", 0.05), bench.effect("hysteresis")
    score = Score(bench.shooting.samples, 60, scale)
    chi2 = wet.chi2 - scale * (score.price([dear]) - 4.0)  # nearly worth it
    more = dataclasses.replace(wet, effects=(*wet.effects, dear), values=(*wet.values, np.array([0.1, 0.1])), chi2=chi2)
    selection = Selection(bench.nominal, [bench.nominal, wet, more], score)
    monkeypatch.setattr(Selection, "rescale", lambda *_: None)
    monkeypatch.setattr(Selection, "may_pay", lambda *_: True)
    seen = []
    monkeypatch.setattr("torch_activegp.diagnosis.selection.search.expand", lambda *args: seen.append(args[3]))
    depth = Depth(swaps=0).counted_from(bench.shooting.work)
    selection.developed.add(frozenset(wet.effects))
    search(selection, bench.shooting, [], lambda words: None, depth)
    assert len([fit for fit in seen if fit is more]) == developed


def test_a_search_that_goes_on_develops_nothing_twice(bench, monkeypatch) -> None:
    developed: list[frozenset[Effect]] = []

    def note(selection: Selection, shooting: Shooting, effects: Sequence[Effect], fit: Fit, work: float) -> None:
        developed.append(frozenset(fit.effects))
        expand(selection, shooting, effects, fit, work)

    monkeypatch.setattr("torch_activegp.diagnosis.selection.search.expand", note)
    effects = [bench.effect(name) for name in ("coulomb_friction", "cubic_spring", "quadratic_drag")]
    glance = select(bench.shooting, effects, bench.nominal, depth=Depth(rounds=1, swaps=0, stepwise=False))
    assert developed == [frozenset()]
    glance.cut_short = glance.in_vain = True  # of which the further search says its own
    whole = Depth().counted_from(bench.shooting.work)
    assert go_on(glance, bench.shooting, effects, lambda words: None, whole) is glance
    assert len(developed) == len(set(developed)) > 1
    assert not glance.cut_short
    assert not glance.in_vain


def test_a_search_that_goes_no_further_was_in_vain(bench) -> None:
    """And not one that has computed enough."""
    effects = [bench.effect(name) for name in NAMES]
    ended = [
        select(bench.shooting, effects, bench.nominal, depth=depth) for depth in (Depth(rounds=0), Depth(work=1.0))
    ]
    assert [(found.cut_short, found.in_vain) for found in ended] == [(True, True), (True, False)]


def test_what_cannot_pay_is_not_developed(bench, monkeypatch) -> None:
    wet = bench.fit("viscous_friction", 0.05)
    selection = Selection(bench.nominal, [bench.nominal, wet], Score(bench.shooting.samples, 60, 1.0))
    seen: list[Fit] = []
    monkeypatch.setattr("torch_activegp.diagnosis.selection.search.expand", lambda *args: seen.append(args[3]))
    for pays in (False, True):
        monkeypatch.setattr(Selection, "may_pay", lambda *_, pays=pays: pays)
        search(selection, bench.shooting, [], lambda words: None, Depth(2, 0).counted_from(bench.shooting.work))
        assert [fit is wet for fit in seen] == [True] * pays


@pytest.mark.parametrize(("tuned", "cut"), [(True, False), (False, False), (True, True)])
def test_once_a_tuning_is_seen_more_of_it_is_undone(bench, monkeypatch, tuned: bool, cut: bool) -> None:
    """Not where the search was cut short: it has computed enough."""
    undone: list[Fit] = []
    monkeypatch.setattr("torch_activegp.diagnosis.selection.search._seems_tuned", lambda *_: tuned)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.search.undo", lambda some, *_: undone.append(some.best))
    depth = Depth(work=1.0 if cut else 1e9)
    chosen = select(bench.shooting, [bench.effect("viscous_friction")], bench.nominal, depth=depth)
    assert undone == [chosen.best] * (tuned and not cut)


@pytest.mark.parametrize(("work", "more", "aside"), [(1e9, 2e6, 2e6), (0.0, 2e6, 2e6), (0.0, 9e9, 5e6)])
def test_what_is_simpler_has_work_of_its_own_however_little_is_left(bench, monkeypatch, work, more, aside) -> None:
    """A drive's search had none left, and named Stribeck's friction in place of dry friction."""
    ends: list[float] = []
    monkeypatch.setattr("torch_activegp.diagnosis.selection.search.simplify", lambda *args: ends.append(args[-1]))
    wet = bench.fit("viscous_friction", 0.05)
    chosen = Selection(bench.nominal, [bench.nominal, wet], Score(bench.shooting.samples, 5, 1.0))
    done = bench.shooting.work
    search(chosen, bench.shooting, list(wet.effects), lambda _: None, Depth(work=work, more=more))
    assert ends
    assert max(work, done) + aside <= min(ends) <= max(ends) <= max(work, bench.shooting.work) + aside
