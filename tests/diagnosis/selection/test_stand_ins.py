from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import stand_ins
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.heats import Heat
from torch_activegp.diagnosis.selection.screening import Atom, Screen, screen
from torch_activegp.diagnosis.selection.stand_ins import (
    _enough,
    _in_place,
    forms_of_parts,
    soften,
    swap,
    try_tuned,
    undo,
    without_needless_bristles,
)
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.springs import LinearSpring


def test_rivals_take_the_place_of_what_was_found(bench) -> None:
    selection = Selection(bench.nominal, [bench.nominal, bench.fit("quadratic_drag", 0.05)], Score(400, 60, 1.0))
    selection.rescale(bench.shooting.dof)
    swap(selection, bench.shooting, [bench.effect("quadratic_drag"), bench.effect("viscous_friction")])
    assert selection.best.keys == {("viscous_friction", "joint:hip")}


def test_what_does_as_well_is_tried_in_its_other_forms_too(clean) -> None:
    """A mass that lies off along two axes looks like an encoder's offset, and along one of them alone like nothing."""
    forms = {e.variant: e for e in clean.effects if e.key == ("center_of_mass_offset", "body:rod")}
    there = clean.predict(Candidate((forms["xz"],), (np.array([0.01, 0.01]),)))
    shooting = dataclasses.replace(clean.shooting, segments=dataclasses.replace(clean.segments, position=there))
    offset = clean.effect("sensor_bias", "sensor:hip")
    nominal, found = shooting.fit([((), ()), ((offset,), (np.array([0.01]),))], clean.nominal.starts)
    selection = Selection(nominal, [nominal, found], Score(shooting.samples, 60, 1.0))
    swap(selection, shooting, [offset, *forms.values()])
    assert selection.best.effects == (forms["xz"],)


def test_dry_friction_that_looks_promising_is_fitted_in_its_soft_form(bench) -> None:
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 60, 1.0))
    assert soften(selection, bench.shooting, bench.effects)
    (fit,) = selection.fits[1:]  # once, though the nominal is the best set too
    assert [(e.name, e.variant) for e in fit.effects] == [("coulomb_friction", "soft")]
    assert fit.chi2 < bench.nominal.chi2
    explained = Selection(bench.nominal, [bench.nominal, bench.fit("viscous_friction", 0.05), fit], selection.score)
    assert not soften(explained, bench.shooting, bench.effects)
    assert len(explained.fits) == 3


def test_soft_friction_is_looked_for_on_top_of_the_nominal_where_the_best_set_led_astray(bench) -> None:
    """The best set holds another form of friction already, and nothing may come on top of it."""
    wet = bench.fit("asymmetric_friction", 0.02, 0.02)
    selection = Selection(bench.nominal, [bench.nominal, wet], Score(bench.shooting.samples, 60, 1.0))
    assert selection.best is wet
    assert soften(selection, bench.shooting, bench.effects)
    assert selection.fits[-1].keys == {("coulomb_friction", "joint:hip")}


@pytest.mark.parametrize("optimum", [True, False])
def test_a_name_that_stands_for_a_tuning_is_tried_beside_all_that_is_tunable(bench, monkeypatch, optimum: bool) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.selection.stand_ins.at_an_optimum", lambda *_: optimum)
    spring, load = bench.effect("cubic_spring"), bench.effect("payload_mass", "body:rod")
    fits = bench.shooting.fit([((spring, load), (np.array([0.1]), np.array([0.07])))], bench.nominal.starts)
    selection = Selection(bench.nominal, [bench.nominal, *fits], Score(bench.shooting.samples, 60, 1.0))
    try_tuned(selection, bench.shooting, bench.effects)
    damping = ("viscous_friction", "joint:hip")
    tried = [fit.keys for fit in selection.fits if damping in fit.keys]
    assert any(spring.key in keys and load.key not in keys for keys in tried) == optimum
    assert any(load.key in keys and spring.key not in keys for keys in tried) == optimum
    known = len(selection.fits)
    try_tuned(selection, bench.shooting, [effect for effect in bench.effects if not effect.tunable])
    assert len(selection.fits) == known
    alone = Selection(bench.nominal, [bench.nominal, bench.fit("cubic_spring", 0.1)], selection.score)
    try_tuned(alone, bench.shooting, bench.effects)
    assert len(alone.fits) == 2


def test_each_of_three_names_is_tried_alone_beside_what_is_tunable(bench, monkeypatch) -> None:
    """On a part of the data first: what is lost there is not fitted to all of them."""
    tried, passed = [], []

    def heat(shooting, sets, fit, score) -> Heat:
        tried.append(sets)
        passed.append(sets if len(tried) == 1 else [])
        return Heat(passed[-1], np.repeat(fit.starts[None], len(passed[-1]), axis=0))

    monkeypatch.setattr("torch_activegp.diagnosis.selection.stand_ins.heat", heat)
    three = tuple(bench.effect(name) for name in ("cubic_spring", "quadratic_drag", "coulomb_friction"))
    values = (np.array([0.1]), np.array([0.01]), np.array([0.01]))
    fits = bench.shooting.fit([(three, values)], bench.nominal.starts)
    score = Score(bench.shooting.samples, 60, 1.0, free=frozenset(e.key for e in bench.effects if e.tunable))
    selection = Selection(bench.nominal, [bench.nominal, *fits], score)
    try_tuned(selection, bench.shooting, bench.effects)
    damping = ("viscous_friction", "joint:hip")
    beside = {frozenset(fit.keys & {e.key for e in three}) for fit in selection.fits if damping in fit.keys}
    assert {frozenset({e.key}) for e in three} <= beside
    selection.fits = selection.fits[:2]
    try_tuned(selection, bench.shooting, bench.effects)
    assert [len(sets) for sets in tried] == [len(tried[0])] * 2
    assert len(selection.fits) == 2


def test_what_gains_more_is_replaced_on_a_smaller_part_of_the_data(bench) -> None:
    """But never on less than a fifth of it, nor on fewer than six segments."""
    twice = bench.shooting.pick(np.tile(np.arange(bench.segments.size), 5))
    sizes = [_enough(twice, gain)[0].segments.size / twice.segments.size for gain in (1.0, 800.0, 1e9)]
    assert sizes == pytest.approx([1.0, 0.5, 0.2])


def test_a_tuning_is_undone_beside_the_best_set(bench) -> None:
    """By the damping that is missing here, and not by names that are not tunable."""
    found = bench.fit("cubic_spring", 0.1)
    selection = Selection(bench.nominal, [bench.nominal, found], Score(bench.shooting.samples, 60, 1.0))
    undo(selection, bench.shooting, bench.effects)
    (fit,) = selection.fits[2:]
    assert found.keys | {("viscous_friction", "joint:hip")} <= fit.keys
    assert all(effect.tunable for effect in fit.effects if effect not in found.effects)
    assert fit.chi2 < 0.5 * found.chi2
    undo(selection, bench.shooting, [effect for effect in bench.effects if not effect.tunable])
    assert len(selection.fits) == 3


def test_rivals_begin_from_the_states_found_on_a_part(bench, monkeypatch) -> None:
    found, begun = bench.fit("viscous_friction", 0.05), []
    starts = np.stack([found.starts + 0.1])
    rival = [((bench.effect("quadratic_drag"),), (np.array([0.02]),))]
    monkeypatch.setattr("torch_activegp.diagnosis.selection.stand_ins.near", lambda *_: Heat(rival, starts))
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.stand_ins.compare", lambda *_, **how: begun.append(how["starts"])
    )
    many = bench.shooting.pick(np.tile(np.arange(bench.segments.size), 5))
    wide = dataclasses.replace(found.pick(np.tile(np.arange(bench.segments.size), 5)), values=found.values)
    selection = Selection(bench.nominal.pick(np.tile(np.arange(bench.segments.size), 5)), [wide], Score(400, 60, 1.0))
    selection.fits.insert(0, selection.nominal)
    swap(selection, many, [bench.effect("quadratic_drag"), bench.effect("viscous_friction")])
    np.testing.assert_array_equal(begun[-1], starts)


@pytest.mark.parametrize(("share", "found"), [(0.4, False), (0.6, True)])
def test_what_explains_most_alone_is_tried_in_its_other_forms_from_where_it_was_fitted(bench, share, found) -> None:
    """Two loads that undo each other stood for the second axis of a centre of mass."""
    shift, load = bench.effect("center_of_mass_offset", "body:rod"), bench.effect("payload_mass", "body:rod")
    best = dataclasses.replace(bench.fit("viscous_friction", 0.05), effects=(shift, load), values=(np.ones(1),) * 2)
    left = bench.nominal.chi2 - share * (bench.nominal.chi2 - best.chi2)
    part = dataclasses.replace(best, effects=(shift,), values=(np.full(1, 0.02),), chi2=left)
    selection = Selection(bench.nominal, [bench.nominal, part, best], Score(bench.shooting.samples, 60, 1.0))
    sets = forms_of_parts(selection, bench.effects, {frozenset(best.effects), frozenset(part.effects)})
    assert bool(sets) is found
    for effects, values in sets:
        assert [effect.key for effect in effects] == [shift.key]
        assert effects[0] is not shift
        assert set(values[0]) <= {0.0, 0.02}


def test_nothing_is_sought_in_place_of_a_name_without_which_another_set_comes_first(bench, monkeypatch) -> None:
    """A name that other initial states alone were: without it the rest fits as well."""
    wet = bench.fit("viscous_friction", 0.05)
    push = bench.effect("constant_force")
    more = dataclasses.replace(wet, effects=(*wet.effects, push), values=(*wet.values, np.zeros(1)))
    found = Selection(bench.nominal, [bench.nominal, more], Score(bench.shooting.samples, 5, 1.0))
    found.rescale(bench.shooting.dof)
    assert found.best is more
    monkeypatch.setattr("torch_activegp.diagnosis.selection.stand_ins.screen", None)
    swap(found, bench.shooting, bench.effects)
    assert found.best.effects == wet.effects


def test_what_gains_as_much_begins_with_the_rest_as_it_is_beside_the_effect_too(bench) -> None:
    wet, push = bench.effect("viscous_friction"), bench.effect("constant_force")
    bias = bench.effect("actuator_bias", "actuator:drive")
    start = ((wet, push), (np.array([0.05]), np.array([0.0])))
    fits = bench.shooting.fit([start], bench.nominal.starts)
    best = dataclasses.replace(fits[0], values=(np.array([0.03]), np.array([0.02])))
    rest = bench.fit("viscous_friction", 0.05)
    found = _in_place(best, push, bench.shooting, rest, [push, bias])
    sets = [dict(zip(*some, strict=True)) for some in found]
    assert [set(some) for some in sets] == [{wet, bias}, {wet, bias}]
    assert [some[wet][0] for some in sets] == [rest.values[0][0], 0.03]
    assert sets[0][bias][0] == sets[1][bias][0]


def test_rivals_are_sought_as_long_as_may_be(bench, monkeypatch) -> None:
    found = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 10, 1.0))
    found.add([bench.fit("viscous_friction", 0.05)])
    ends: list[float] = []
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.stand_ins.without_each",
        lambda selection, *a: ends.append(a[-1]) or [(selection.best.effects[0], bench.nominal)],
    )
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.stand_ins.compare", lambda *args, **_: ends.append(args[4].work)
    )
    swap(found, bench.shooting, [bench.effect("quadratic_drag"), bench.effect("viscous_friction")], 7e6)
    assert ends == [7e6, 7e6]


def test_all_that_gain_as_much_are_tried(bench, monkeypatch) -> None:
    """An encoder's offset behind four others that gain a little more is no worse a name."""
    names = (
        "constant_force",
        "linear_spring",
        "coulomb_friction",
        "cogging",
        "armature_error",
        "sensor_bias",
        "hysteresis",
    )
    gains = dict(zip(names, (100.0, 101.0, 100.5, 100.2, 100.1, 99.5, 98.0), strict=True))
    effects = [next(e for e in bench.effects if e.name == name and not e.stands_in) for name in names]
    atoms = tuple(Atom(e, e.seeds[0], gains[e.name], slice(0, 1), e.seeds[0]) for e in effects)
    monkeypatch.setattr(stand_ins, "screen", lambda *_: Screen(atoms, np.eye(1), np.zeros(1)))
    monkeypatch.setattr(stand_ins, "_by_two", lambda *_: [])
    best = bench.fit("constant_force", 0.05)
    found = _in_place(best, best.effects[0], bench.shooting, bench.nominal, effects)
    tried = {effect.name for some, _ in found for effect in some}
    assert tried == {*names[1:6]}


def test_two_names_are_tried_in_place_of_one_that_may_stand_for_both(clean) -> None:
    """A spring that rests elsewhere stood for weight and a push: neither in its place comes near, nor any on top."""
    gravity = next(e for e in clean.effects if e.name == "gravity_error" and e.variant == "z")
    push, spring = clean.effect("constant_force"), next(e for e in clean.effects if isinstance(e, LinearSpring))
    there = clean.predict(Candidate((gravity, push), (np.array([-4.0]), np.array([0.1]))))
    segments = dataclasses.replace(clean.segments, position=there)
    shooting = dataclasses.replace(clean.shooting, segments=segments)
    nominal, found = shooting.fit([((), ()), ((spring,), (np.array([2.0, 0.1]),))], clean.nominal.starts)
    selection = Selection(nominal, [nominal, found], Score(shooting.samples, 60, 1.0))
    swap(selection, shooting, [spring, gravity, push])
    both = selection.of((gravity, push))
    assert both is not None
    assert both.chi2 < 0.01 * found.chi2
    single = [selection.of((one,)) for one in (gravity, push)]
    assert all(fit is None or fit.chi2 > found.chi2 for fit in single)


@pytest.mark.parametrize(("own", "adds", "found"), [(1.0, 0.0, 1), (1.2, 0.0, 0), (1.0, 1e9, 0)])
def test_two_must_do_about_as_much_as_the_one_and_each_its_part(clean, monkeypatch, own, adds, found) -> None:
    monkeypatch.setattr(stand_ins, "_ADDS", adds)
    gravity = next(e for e in clean.effects if e.name == "gravity_error" and e.variant == "z")
    push, spring = clean.effect("constant_force"), next(e for e in clean.effects if isinstance(e, LinearSpring))
    there = clean.predict(Candidate((gravity, push), (np.array([-1.0]), np.array([0.1]))))
    shooting = dataclasses.replace(clean.shooting, segments=dataclasses.replace(clean.segments, position=there))
    nominal = shooting.fit([((), ())], clean.nominal.starts)[0]
    screened = screen(shooting, nominal, [spring, gravity, push])
    gain = screened.joint_gain([atom for atom in screened.atoms if atom.effect in (gravity, push)])
    pairs = stand_ins._by_two(nominal, screened, screened.best(), spring, own * gain)
    assert [{e.name for e in some} for some, _ in pairs] == [{"gravity_error", "constant_force"}] * found


def test_two_of_which_one_contains_the_other_are_no_pair(bench) -> None:
    """Dry friction and Stribeck's are one law too many on a joint; and no form of what is replaced takes its place."""
    dry, more = bench.effect("coulomb_friction"), bench.effect("stribeck_friction")
    wet, both_ways = bench.effect("viscous_friction"), bench.effect("asymmetric_friction")
    screened = screen(bench.shooting, bench.nominal, [dry, more, wet, both_ways])
    for effect in (bench.effect("quadratic_drag"), dry):
        pairs = stand_ins._by_two(bench.nominal, screened, screened.best(), effect, 0.0)
        names = [{e.name for e in some} for some, _ in pairs]
        assert all(len(some & {"coulomb_friction", "stribeck_friction"}) < 2 for some in names)
        assert all(len(some & {"viscous_friction", "asymmetric_friction"}) < 2 for some in names)
        assert all(effect.name not in some for some in names)


@pytest.mark.parametrize(
    ("scale", "name", "found"),
    [(4.1, "backlash", True), (3.9, "backlash", False), (4.1, "coulomb_friction", False)],
)
def test_the_one_name_that_leaves_least_is_tried_in_its_other_forms_where_much_is_left(
    bench, scale, name, found
) -> None:
    """A gap left less than any other name, and with the joint's damping on the motor a fifth of that."""
    wet, least = bench.fit("viscous_friction", 0.05), bench.effect(name)
    two = (bench.effect("constant_force"), bench.effect("quadratic_drag"))
    best = dataclasses.replace(wet, effects=two, values=(np.ones(1),) * 2)
    gain = bench.nominal.chi2 - best.chi2
    others = [
        dataclasses.replace(wet, effects=(effect,), values=(effect.seeds[0],), chi2=bench.nominal.chi2 - share * gain)
        for effect, share in ((least, 0.7), (bench.effect("stribeck_friction"), 0.6))
    ]
    selection = Selection(bench.nominal, [bench.nominal, *others, best], Score(bench.shooting.samples, 60, scale))
    sets = forms_of_parts(selection, bench.effects, set())
    assert bool(sets) is found
    assert {effects[0].key for effects, _ in sets} <= {least.key}
    assert all(effects[0] is not least for effects, _ in sets)


def with_bristles(bench):
    """The forms of a dry friction, a push, and a fit of something to change."""
    forms = {effect.variant: effect for effect in bench.effects if effect.name == "coulomb_friction"}
    return forms, bench.effect("constant_force"), bench.fit("viscous_friction", 0.05)


def test_bristles_are_tried_where_more_than_noise_is_left_or_where_they_spare_a_name(bench) -> None:
    forms, push, wet = with_bristles(bench)
    bristled = forms["bristles"]
    best = dataclasses.replace(wet, effects=(forms[""], push), values=(np.ones(1),) * 2)
    alone, beside = ((bristled,), (bristled.seeds[0],)), ((bristled, push), (bristled.seeds[0], np.ones(1)))
    firm = ((forms["soft"], push), (np.ones(1), np.ones(1)))
    for scale, kept in ((1.05, [firm, alone]), (1.5, [firm, alone, beside])):  # and last
        selection = Selection(best, [best], Score(bench.shooting.samples, 60, scale))
        assert without_needless_bristles([alone, beside, firm], selection) == kept


def test_bristles_of_the_best_set_stay_in_its_rivals(bench) -> None:
    forms, push, wet = with_bristles(bench)
    bristled = forms["bristles"]
    best = dataclasses.replace(wet, effects=(bristled, push), values=(bristled.seeds[0], np.ones(1)))
    rival = ((bristled, bench.effect("quadratic_drag")), (bristled.seeds[0], np.ones(1)))
    selection = Selection(best, [best], Score(bench.shooting.samples, 60, 1.05))
    assert without_needless_bristles([rival], selection) == [rival]


@pytest.mark.parametrize("scale", [1.05, 1.5])
def test_no_needless_bristles_come_in_place_of_a_name(bench, monkeypatch, scale: float) -> None:
    forms, push, wet = with_bristles(bench)
    tried: list = []
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.stand_ins._in_place",
        lambda *_: [((forms["bristles"], push), (forms["bristles"].seeds[0], np.ones(1)))],
    )
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.stand_ins.compare", lambda _, __, sets, *a, **k: tried.extend(sets)
    )
    fits = bench.shooting.fit([((forms[""], push), (np.array([0.05]), np.array([0.1])))], bench.nominal.starts)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.stand_ins.without_each", lambda *_: [(push, wet)])
    selection = Selection(bench.nominal, [bench.nominal, *fits], Score(bench.shooting.samples, 60, scale))
    if selection.best is fits[0]:
        swap(selection, bench.shooting, bench.effects)
        assert bool([e for effects, _ in tried for e in effects if e.variant == "bristles"]) is (scale > 1.1)
    else:
        raise AssertionError("the friction and the push come first")
