from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.proposals import (
    also_from,
    beginning,
    companies,
    diverse,
    join,
    richer,
    simpler,
    softened,
    with_another_past,
    with_values,
    without_weak,
)
from torch_activegp.diagnosis.selection.screening import Atom, screen


def test_a_law_takes_over_what_a_simpler_one_explains(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    atoms = screen(bench.shooting, fit, bench.effects).best()
    both = next(a for a in atoms if a.effect.name == "asymmetric_friction" and "viscous_friction" in a.effect.covers)
    effects, values = join(fit, [both])
    assert effects == (both.effect,)
    np.testing.assert_allclose(values[0], both.values + fit.values[0][0])
    spring = next(a for a in atoms if a.effect.name == "linear_spring")
    assert [e.name for e in join(fit, [spring])[0]] == ["viscous_friction", "linear_spring"]


def test_richer_laws_start_as_the_law_that_they_contain(bench) -> None:
    fit = bench.fit("coulomb_friction", 0.01)
    sets = richer(fit, bench.effects)
    names = {effects[0].name for effects, _ in sets}
    assert names == {"stribeck_friction", "asymmetric_friction"}
    for effects, values in sets:
        assert values[0][0] == pytest.approx(fit.values[0][0])
        if effects[0].name == "asymmetric_friction":
            assert values[0][1] == pytest.approx(fit.values[0][0])
    assert richer(bench.nominal, bench.effects) == []


def test_forms_that_stand_in_are_no_richer_law_and_none_with_more_than_a_level_is_a_simpler_one(bench) -> None:
    """Bristles are tried in place of the firm law alone; of three numbers they have no level to begin with."""
    dry = bench.fit("coulomb_friction", 0.05)
    assert {e.variant for effects, _ in richer(dry, bench.effects) for e in effects} <= {"", "coulomb"}
    rich = next(e for e in bench.effects if e.name == "stribeck_friction" and not e.variant)
    fit = dataclasses.replace(dry, effects=(rich,), values=(rich.seeds[0],))
    plain = [(e, v) for effects, vs in simpler(fit, bench.effects, {}, 0.0) for e, v in zip(effects, vs, strict=True)]
    assert {len(v) for e, v in plain if e.name == "coulomb_friction"} == {1}
    assert all(len(value) == len(effect.parameters) for effect, value in plain)


def test_a_static_excess_that_bristles_made_up_for_may_go_and_they_stay(bench) -> None:
    forms = {(e.name, e.variant): e for e in bench.effects if e.target == "joint:hip"}
    rich, plain = forms["stribeck_friction", "bristles"], forms["coulomb_friction", "bristles"]
    value = np.array([0.04, 0.02, 0.3, 9e3, 7.0])
    fit = dataclasses.replace(bench.nominal, effects=(rich,), values=(value,), chi2=1000.0)
    found = {effects: values for effects, values in simpler(fit, bench.effects, {}, 0.0)}
    np.testing.assert_allclose(found[(plain,)][0], [0.03, 9e3, 7.0])


def test_a_law_begins_as_what_it_contains_or_as_it_was(bench) -> None:
    """Stribeck's friction without an excess, at its own width; two equal levels; a spring contains no friction."""
    level, pairs = 0.01, [(bench.effect("coulomb_friction"), np.array([0.01]))]
    stribeck, spring = bench.effect("stribeck_friction"), bench.effect("linear_spring")
    two = next(e for e in bench.effects if e.name == "asymmetric_friction" and e.covers == ("coulomb_friction",))
    np.testing.assert_array_equal(beginning(stribeck, np.array([0.2, 0.4, 0.3]), pairs), [level, 0.0, 0.3])
    np.testing.assert_array_equal(beginning(two, np.array([0.2, 0.4]), pairs), [level, level])
    np.testing.assert_array_equal(beginning(spring, np.array([0.2]), pairs), [0.2])


def test_no_more_than_two_of_a_kind(bench) -> None:
    atoms = list(screen(bench.shooting, bench.nominal, bench.effects).atoms)
    chosen = diverse(atoms, 8)
    keys = [atom.effect.key for atom in chosen]
    assert len(chosen) == 8
    assert max(keys.count(key) for key in keys) <= 2


def test_together_equals_the_gain_of_the_pair(bench) -> None:
    screened = screen(bench.shooting, bench.nominal, bench.effects)
    first, second = screened.best()[:2]
    gain, values = screened.together([first, second])
    assert gain == screened.joint_gain([first, second]) >= max(first.gain, second.gain) - 1e-6
    assert [v.shape for v in values] == [first.values.shape, second.values.shape]


def test_a_simpler_law_that_got_stuck_elsewhere_is_tried_from_here(bench) -> None:
    wet, spring = bench.effect("viscous_friction"), bench.effect("linear_spring")
    rich = next(e for e in bench.effects if e.name == "asymmetric_friction" and "viscous_friction" in e.covers)
    values = (np.array([0.07, 0.05]), np.array([0.1, 0.0]))
    fit = dataclasses.replace(bench.nominal, effects=(rich, spring), values=values, chi2=1000.0)
    names = {tuple(e.name for e in effects): v for effects, v in simpler(fit, bench.effects, {}, 1040.0)}
    assert set(names) == {
        ("linear_spring",),
        ("asymmetric_friction",),
        ("linear_spring", "viscous_friction"),
        ("linear_spring", "viscous_friction", "constant_force"),
    }
    np.testing.assert_allclose(names["linear_spring", "viscous_friction"][1], 0.06)
    plain = frozenset({spring, wet})
    for chi2, again in ((1030.0, False), (5000.0, True)):
        sets = simpler(fit, bench.effects, {plain: chi2, frozenset({spring}): chi2}, 1040.0)
        assert (plain in {frozenset(effects) for effects, _ in sets}) == again
        assert frozenset({spring}) not in {frozenset(effects) for effects, _ in sets}


def test_another_form_of_a_name_is_tried_in_its_place(bench) -> None:
    forms = {e.variant: e for e in bench.effects if e.key == ("coulomb_friction", "joint:hip")}
    for one, others in (("", {"soft", "bristles"}), ("soft", {"", "bristles"}), ("bristles", {"", "soft"})):
        value = np.array([0.02, *forms[one].seeds[0][1:]])
        fit = dataclasses.replace(bench.nominal, effects=(forms[one],), values=(value,), chi2=1000.0)
        sets = simpler(fit, bench.effects, {}, 1040.0)
        assert {effect.variant for (effect,), _ in sets} == others
        assert all(value[0] == 0.02 for _, (value,) in sets)
        known = {frozenset(effects): 2000.0 for effects, _ in sets}
        assert simpler(fit, bench.effects, known, 1040.0) == []


def test_what_one_form_leaves_to_a_second_name_another_form_may_hold_alone(bench) -> None:
    forms = {e.variant: e for e in bench.effects if e.key == ("center_of_mass_offset", "body:rod")}
    bias = bench.effect("sensor_bias", "sensor:hip")
    values = (np.array([0.02]), np.array([0.05]))
    fit = dataclasses.replace(bench.nominal, effects=(bias, forms["z"]), values=values, chi2=1000.0)
    found = {frozenset(effects): vs for effects, vs in simpler(fit, bench.effects, {}, 1040.0)}
    assert frozenset({bias, forms["xz"]}) in found
    np.testing.assert_allclose(found[frozenset({forms["xz"]})][0], [0.0, 0.05])
    assert frozenset({forms["xz"]}) not in {
        frozenset(effects) for effects, _ in simpler(fit, bench.effects, {frozenset({forms["xz"]}): 1.0}, 1040.0)
    }


def test_weak_effects_leave_together(bench) -> None:
    effects = tuple(bench.effect(name) for name in ("viscous_friction", "constant_force", "armature_error"))
    fit = bench.shooting.fit([(effects, tuple(np.array([0.01]) for _ in effects))], bench.nominal.starts)[0]
    fewer = without_weak(fit, lambda effect: 20.0)
    assert fewer is not None
    assert [e.name for e in fewer[0]] == ["viscous_friction"]
    assert without_weak(bench.fit("viscous_friction", 0.05), lambda effect: 20.0) is None


def test_friction_that_can_hold_a_joint_is_also_tried_small(bench) -> None:
    atoms = screen(bench.shooting, bench.nominal, bench.effects).best()
    dry = next(a for a in atoms if a.effect.name == "stribeck_friction")
    spring = next(a for a in atoms if a.effect.name == "linear_spring")
    assert also_from((spring,)) == [(spring,)]
    full, less = also_from((dry, spring))
    assert full == (dry, spring)
    np.testing.assert_allclose(less[0].values[:2], 0.15 * dry.values[:2])
    assert less[0].values[2] == dry.values[2]
    np.testing.assert_array_equal(less[1].values, spring.values)


def test_a_stop_is_also_tried_with_more_damping(bench) -> None:
    stop, spring = bench.effect("joint_stop"), bench.effect("linear_spring")
    screened = screen(bench.shooting, bench.nominal, [stop, spring]).best()
    values = [np.array([100.0, 0.1, 0.4]) if a.effect is stop else np.array([0.1, 0.0]) for a in screened]
    atoms = sorted(with_values(screened, values), key=lambda a: a.effect is spring)
    dampings = [some[0].values[1] for some in also_from(atoms)]
    np.testing.assert_allclose(dampings, [0.1, np.sqrt(100 * 0.33), 2 * np.sqrt(100 * 0.33)], rtol=1e-6)
    assert all(some[1].values[0] == 0.1 for some in also_from(atoms))


def test_friction_and_a_constant_push_are_one_asymmetric_friction(bench) -> None:
    rich = next(e for e in bench.effects if e.name == "asymmetric_friction" and "coulomb_friction" in e.covers)
    dry, spring = bench.effect("coulomb_friction"), bench.effect("linear_spring")
    for push in (bench.effect("constant_force"), bench.effect("actuator_bias", "actuator:drive")):
        values = (np.array([0.2]), np.array([0.1]), np.array([0.3, 0.0]))
        fit = dataclasses.replace(bench.nominal, effects=(dry, push, spring), values=values, chi2=1000.0)
        found = {
            frozenset(effects): dict(zip(effects, vs, strict=True))
            for effects, vs in simpler(fit, bench.effects, {}, 1e3)
        }
        np.testing.assert_allclose(found[frozenset({rich, spring})][rich], [0.1, 0.3])
        weak = dataclasses.replace(fit, values=(np.array([0.05]), *values[1:]))  # would push in one direction
        assert frozenset({rich, spring}) not in {frozenset(e) for e, _ in simpler(weak, bench.effects, {}, 1e3)}


def test_effects_that_hide_each_other_are_seen_together() -> None:
    def atom(name: str, covers: tuple[str, ...] = ()) -> SimpleNamespace:
        return SimpleNamespace(effect=SimpleNamespace(key=(name, "joint:a"), name=name, covers=covers))

    dry, wet, bias, rich = atom("dry"), atom("wet"), atom("bias"), atom("rich", ("dry",))
    gains = {"dry": 50.0, "wet": 60.0, "bias": 1.0, "dry wet": 200.0, "bias dry wet": 300.0, "bias wet": 61.0}

    def worth(company: tuple[SimpleNamespace, ...]) -> float:
        names = " ".join(sorted(a.effect.name for a in company))
        return 1e9 if "rich" in names else gains.get(names, 0.0)

    found = companies([dry, wet, bias, rich], worth, 4, 20.0)
    assert [{a.effect.name for a in company} for company in found] == [{"dry", "wet"}, {"dry", "wet", "bias"}]
    assert len(companies([dry, wet, bias, rich], worth, 2, 20.0)) == 1
    assert companies([dry, wet, bias], worth, 4, 1000.0) == []
    poor = {name: gain - 300.0 for name, gain in gains.items()}
    assert companies([dry, wet], lambda company: poor[" ".join(sorted(a.effect.name for a in company))], 4, 20.0) == []


def test_two_levels_are_one_and_a_bias_that_is_no_name(bench) -> None:
    """Where the drive's bias was tuned; else it costs a name, as the constant force does that says the same."""
    rich = next(e for e in bench.effects if e.name == "asymmetric_friction" and "coulomb_friction" in e.covers)
    dry, bias = bench.effect("coulomb_friction"), bench.effect("actuator_bias", "actuator:drive")
    fit = dataclasses.replace(bench.nominal, effects=(rich,), values=(np.array([0.1, 0.3]),), chi2=1000.0)
    found = {frozenset(some[0]): some for some in simpler(fit, bench.effects, {}, 1040.0, {bias.key})}
    effects, values = found[frozenset({dry, bias})]
    assert effects == (dry, bias)
    np.testing.assert_allclose(np.concatenate(values), [0.2, 0.1])
    assert frozenset({dry, bias}) not in {frozenset(e) for e, _ in simpler(fit, bench.effects, {}, 1040.0)}


def test_cogging_that_comes_once_more_is_one_effect_of_two_waves(bench) -> None:
    wave = bench.effect("cogging")
    fit = bench.fit("cogging", 0.01, 0.0, 3.0)
    atom = Atom(wave, np.array([0.02, 0.03, 7.0]), 10.0, slice(0, 2), wave.seeds[0])
    (effect,), (values,) = join(fit, [atom])
    assert effect is wave.more
    assert values[2:4].tolist() == [0.02, 0.03]
    assert values[-2:] == pytest.approx([fit.values[0][2], 7.0])
    (third,), (more,) = join(dataclasses.replace(fit, effects=(effect,), values=(values,)), [atom])
    assert third is effect.more and len(more) == 9
    assert third.more is None
    full = dataclasses.replace(fit, effects=(third,), values=(more,))
    assert join(full, [atom])[0] == (third,)


def test_firm_friction_in_a_set_has_a_soft_form(bench) -> None:
    firm, drag = bench.effect("coulomb_friction"), bench.effect("quadratic_drag")
    sets = [((drag, firm), (np.array([0.2]), np.array([0.3]))), ((drag,), (np.array([0.2]),))]
    (((kept, soft), values),) = softened(sets, bench.effects)
    assert (kept, soft.key, soft.variant) == (drag, firm.key, "soft")
    assert [value.tolist() for value in values] == [[0.2], [0.3]]
    assert softened([((soft,), (np.array([0.3]),))], bench.effects) == []


def test_other_forms_of_what_remembers_come_last(bench) -> None:
    forms = {e.variant: e for e in bench.effects if e.name == "backlash"}
    play, spring = forms[""], bench.effect("linear_spring")
    values = (np.array([0.02] * len(play.parameters)), np.array([0.1, 0.0]))
    fit = dataclasses.replace(bench.nominal, effects=(play, spring), values=values, chi2=1000.0)
    now = [frozenset(effects) for effects, _ in simpler(fit, bench.effects, {}, 1040.0)]
    assert frozenset({play}) in now and frozenset({spring}) in now
    assert not any(some & {*forms.values()} - {play} for some in now)
    later = [frozenset(effects) for effects, _ in with_another_past(fit, bench.effects, ())]
    others = {form for some in later for form in some} - {spring}
    assert {"resting", "springy"} <= {form.variant for form in others} <= {*forms} - {""}
    assert set(later) == {frozenset({form, *more}) for form in others for more in ((), (spring,))}
    assert frozenset({forms["resting"]}) not in {
        frozenset(effects) for effects, _ in with_another_past(fit, bench.effects, {frozenset({forms["resting"]})})
    }
    kept = [effects for effects, _ in with_another_past(fit, bench.effects, (), {spring.key})]
    assert kept and all(spring in effects for effects in kept)  # what is no name stays
    alone = dataclasses.replace(fit, effects=(spring,), values=values[1:])
    assert with_another_past(alone, bench.effects, ()) == []


def test_each_effect_is_weighed_by_its_own_information(bench) -> None:
    effects = (bench.effect("viscous_friction"), bench.effect("constant_force"))
    values = (np.array([1.0]), np.array([1.0]))
    fit = dataclasses.replace(bench.nominal, effects=effects, values=values, information=np.diag([100.0, 0.01]))
    assert without_weak(fit, lambda _: 10.0) == (effects[:1], values[:1])
    assert without_weak(fit, lambda _: 0.001) is None
