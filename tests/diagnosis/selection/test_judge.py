from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection import judge as module
from torch_activegp.diagnosis.selection.adequacy import SEEN
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.judge import _split, judge
from torch_activegp.diagnosis.selection.omnibus import Omnibus, omnibus
from torch_activegp.diagnosis.shooting.score import Score


def selection(bench, *fits, names: int = 20) -> Selection:
    return Selection(bench.nominal, [bench.nominal, *fits], Score(bench.shooting.samples, names, 1.0))


def test_noise_alone_is_none(clean) -> None:
    judged = judge(clean.shooting, selection(clean))
    assert (judged.verdict, judged.named, judged.unexplained, judged.white) == ("none", (), 0.0, True)


def test_a_mismatch_that_no_set_explains_is_unknown(bench) -> None:
    judged = judge(bench.shooting, selection(bench))
    assert (judged.verdict, judged.named, judged.unexplained) == ("unknown", (), 1.0)
    assert judged.p_value < 1e-12


def test_a_set_that_leaves_much_is_unknown(bench) -> None:
    judged = judge(bench.shooting, selection(bench, bench.fit("constant_force", 0.01)))
    assert judged.verdict == "unknown"
    assert judged.unexplained > 0.5
    assert not judged.white


def test_laws_that_contain_a_name_tie_whatever_is_not_named_beside_it(bench, monkeypatch) -> None:
    fit, spare = bench.fit("viscous_friction", 0.05), ("constant_force", "joint:hip")
    asked: list = []
    monkeypatch.setattr(module, "unnamed", lambda *_: frozenset({spare, fit.effects[0].key}))
    monkeypatch.setattr(module, "as_part", lambda *args: asked.append(args[2:]) or (spare,))
    assert judge(bench.shooting, selection(bench, fit)).ties == ((spare,),)
    assert asked == [(fit.effects[0], frozenset({spare}))]  # a name is not spare beside itself


def test_the_effect_that_explains_all_is_named(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    judged = judge(bench.shooting, selection(bench, fit, bench.fit("quadratic_drag", 0.02)))
    assert (judged.verdict, judged.named, judged.ties, judged.retuned) == ("named", fit.effects, ((),), ())
    assert judged.shares[0] == pytest.approx(1.0, abs=0.03)
    assert judged.probabilities[0] > 0.99
    assert judged.p_value < 1e-12
    assert sum(weight for _, _, weight in judged.rivals) == pytest.approx(1.0)
    distances = [distance for _, distance, _ in judged.rivals]
    assert distances == sorted(distances) and distances[0] == 0.0


@pytest.mark.parametrize(("gained", "verdict"), [(5.0, "unknown"), (15.0, "named")])
def test_a_name_must_score_better_than_none_by_far(bench, monkeypatch, gained: float, verdict: str) -> None:
    """Above all prices."""
    monkeypatch.setattr(module, "leaves_much", lambda *_: False)
    found = selection(bench, bench.fit("viscous_friction", 0.05))
    less = found.score(bench.nominal) - found.score(found.best) - gained
    weak = dataclasses.replace(found.best, chi2=found.best.chi2 + less * found.score.scale)
    judged = judge(bench.shooting, selection(bench, weak))
    assert (judged.verdict, bool(judged.named)) == (verdict, verdict == "named")
    assert judged.rivals[0][0] is weak


@pytest.mark.parametrize(
    ("gained", "part", "names"), [(49.0, 0.0, 1), (51.0, 0.0, 2), (None, 0.0, 2), (51.0, 0.3, 1), (130.0, 0.3, 2)]
)
def test_each_of_several_names_is_needed_by_far(bench, monkeypatch, gained, part: float, names: int) -> None:
    """Where the set without it was fitted, and of the noise too; what is not needed is fitted along."""
    monkeypatch.setattr(module, "BESIDE", part)
    monkeypatch.setattr(module, "is_certain", lambda *_, **__: True)
    monkeypatch.setattr(module, "_split", lambda *_: (effects, ()))
    monkeypatch.setattr(module, "_shares", lambda shooting, selection, named, _: (tuple(named), (0.9, 0.1)))
    effects, one = (
        (bench.effect("viscous_friction"), bench.effect("quadratic_drag")),
        bench.fit("viscous_friction", 0.05),
    )
    both = bench.shooting.fit([(effects, (one.values[0], np.array([0.01])))], one.starts, hold=True)[0]
    chosen = selection(bench, both)
    rest = dataclasses.replace(one, chi2=both.chi2 + (gained or 0.0) * chosen.score.scale)
    other = dataclasses.replace(both, effects=effects[1:], values=both.values[1:], chi2=1e9)
    if gained is not None:
        chosen.add([rest, other])
    judged = judge(bench.shooting, chosen)
    assert judged.named == effects[:names]
    assert judged.retuned == effects[names:]


def test_what_other_time_steps_do_without_is_no_name(bench) -> None:
    effects = (bench.effect("viscous_friction"), bench.effect("quadratic_drag"))
    one = bench.fit("viscous_friction", 0.05)
    chosen = selection(bench, one)
    chosen.of_a_step = frozenset(effects[1:])
    assert judge(bench.shooting, chosen).named == one.effects
    chosen.of_a_step = frozenset(effects[:1])
    assert judge(bench.shooting, chosen).named == one.effects  # for nothing else is


def test_sets_that_score_alike_are_a_tie(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    twin = dataclasses.replace(fit, effects=(bench.effect("quadratic_drag"),), chi2=fit.chi2 + 3.0)
    judged = judge(bench.shooting, selection(bench, fit, twin))
    assert (judged.verdict, judged.ties) == ("tie", ((("quadratic_drag", "joint:hip"),),))
    assert judged.probabilities[0] == pytest.approx(1 / (1 + np.exp(-1.5)), abs=0.02)
    far = dataclasses.replace(twin, chi2=fit.chi2 + 9.0)
    assert judge(bench.shooting, selection(bench, fit, far)).verdict == "named"


def test_shares_go_by_what_each_adds_and_next_to_nothing_is_not_named(bench, monkeypatch) -> None:
    effects = (bench.effect("constant_force"), bench.effect("viscous_friction"))
    both = bench.shooting.fit([(effects, (np.array([0.0]), np.array([0.05])))], bench.nominal.starts)[0]
    judged = judge(bench.shooting, selection(bench, both))
    assert [effect.name for effect in judged.named] == ["viscous_friction"]
    assert [effect.name for effect in judged.retuned] == ["constant_force"]
    assert judged.fit.effects == effects
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.LEAST_SHARE", 0.0)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.is_certain", lambda *_, alone=False: alone)
    assert judge(bench.shooting, selection(bench, both)).named == judged.named  # one of the two is sure to be there
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.is_certain", lambda *_, **__: False)
    assert judge(bench.shooting, selection(bench, both)).named == ()
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.is_certain", lambda *_, **__: True)
    judged = judge(bench.shooting, selection(bench, both))
    assert [effect.name for effect in judged.named] == ["viscous_friction", "constant_force"]
    assert judged.shares[0] > 0.95 > 0.05 > judged.shares[1] >= 0.0


def test_as_many_names_as_are_tried_must_explain_nearly_all(bench, monkeypatch) -> None:
    effect = bench.effect("viscous_friction")
    half = bench.shooting.fit([((effect,), (np.array([0.045]),))], bench.nominal.starts, hold=True)[0]
    judged = judge(bench.shooting, selection(bench, half))
    assert judged.verdict == "named"
    assert 0.04 < judged.unexplained < 0.15
    for most, left in ((1, 0.04), (0, 1.0)):
        monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.MAX_EFFECTS", most)
        monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.CROWDED", left)
        assert judge(bench.shooting, selection(bench, half)).verdict == "unknown"
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.OVERCROWDED", 0.15)
    assert judge(bench.shooting, selection(bench, half)).verdict == "named"


@pytest.mark.parametrize(("damping", "verdict"), [(0.045, "unknown"), (0.03, "none")])
def test_many_names_that_explain_little_of_a_small_mismatch_are_nothing(bench, monkeypatch, damping, verdict) -> None:
    effect = bench.effect("viscous_friction")
    some = bench.shooting.fit([((effect,), (np.array([damping]),))], bench.nominal.starts, hold=True)[0]
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.MAX_EFFECTS", 1)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE", 1e3)
    judged = judge(bench.shooting, selection(bench, some))
    assert judged.verdict == verdict
    assert (
        (0.0 < judged.unexplained < 0.15) if verdict == "unknown" else (judged.unexplained, judged.white) == (0.0, True)
    )


@pytest.mark.parametrize(
    ("damping", "little", "verdict"), [(0.03, 0.5, "named"), (0.01, 0.5, "none"), (0.01, 0.9, "named")]
)
def test_what_explains_less_than_half_of_a_small_mismatch_is_not_named(
    bench, monkeypatch, damping, little, verdict
) -> None:
    effect = bench.effect("viscous_friction")
    some = bench.shooting.fit([((effect,), (np.array([damping]),))], bench.nominal.starts, hold=True)[0]
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.least_gain", lambda *_: 0.0)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.LITTLE", little)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE", 1e3)
    assert judge(bench.shooting, selection(bench, some)).verdict == verdict


@pytest.mark.parametrize(("visible", "verdict"), [(1e-3, "unknown"), (1e3, "named")])
def test_less_may_be_left_where_it_is_large_against_the_noise(bench, monkeypatch, visible, verdict) -> None:
    effect = bench.effect("viscous_friction")
    most = bench.shooting.fit([((effect,), (np.array([0.045]),))], bench.nominal.starts, hold=True)[0]
    assert 0.053 < SEEN < 0.065  # the most that right names left, and the least that wrong ones did
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.SEEN", 0.04)
    chosen = selection(bench, most)
    before = omnibus(bench.shooting, chosen.nominal)
    after = omnibus(bench.shooting, most)
    assert after.excess < before.excess
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE", visible * after.excess / bench.shooting.dof)
    judged = judge(bench.shooting, chosen)
    assert 0.04 < judged.unexplained < 0.15
    assert judged.verdict == verdict


@pytest.mark.parametrize(("many", "verdict"), [(1, "unknown"), (2, "named")])
def test_less_may_be_left_behind_many_names(bench, monkeypatch, many: int, verdict: str) -> None:
    effect = bench.effect("viscous_friction")
    most = bench.shooting.fit([((effect,), (np.array([0.045]),))], bench.nominal.starts, hold=True)[0]
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.MANY", many)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.SEEN", 0.15)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE", 1e-3)
    judged = judge(bench.shooting, selection(bench, most))
    assert 0.04 < judged.unexplained < 0.15
    assert judged.verdict == verdict


@pytest.mark.parametrize("rule", [("CLEAR", "SEEN_CLEARLY"), ("LOUD", "SEEN_LOUD")])
@pytest.mark.parametrize(
    ("above", "least", "verdict"), [(0.9, 0.04, "unknown"), (1.1, 0.04, "named"), (0.9, 0.15, "named")]
)
def test_less_may_be_left_where_it_is_many_times_the_noise(bench, monkeypatch, rule, above, least, verdict) -> None:
    effect = bench.effect("viscous_friction")
    most = bench.shooting.fit([((effect,), (np.array([0.045]),))], bench.nominal.starts, hold=True)[0]
    for name, value in (("SEEN", 0.15), ("CLEAR", np.inf), ("LOUD", np.inf)):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.adequacy.{name}", value)
    for name, value in zip(rule, (above * most.chi2 / bench.shooting.dof, least), strict=True):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.adequacy.{name}", value)
    judged = judge(bench.shooting, selection(bench, most))
    assert 0.04 < judged.unexplained < 0.15
    assert judged.verdict == verdict


@pytest.mark.parametrize(("cut_short", "verdict"), [(True, "unknown"), (False, "named")])
def test_less_may_be_left_by_a_search_that_was_cut_short(bench, monkeypatch, cut_short, verdict) -> None:
    """Also where what is left would not be seen otherwise."""
    effect = bench.effect("viscous_friction")
    most = bench.shooting.fit([((effect,), (np.array([0.045]),))], bench.nominal.starts, hold=True)[0]
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.SEEN", 0.15)
    chosen = dataclasses.replace(selection(bench, most), cut_short=cut_short)
    judged = judge(bench.shooting, chosen)
    assert 0.04 < judged.unexplained < 0.15
    assert judged.verdict == verdict


@pytest.mark.parametrize(
    ("corrections", "little", "verdict"), [(5, 0.9, "unknown"), (5, 1.1, "named"), (4, 0.9, "named")]
)
def test_less_may_be_left_behind_many_corrections_of_a_tuning(bench, monkeypatch, corrections, little, verdict) -> None:
    """Where it is more than a little of the noise."""
    effect = bench.effect("viscous_friction")
    most = bench.shooting.fit([((effect,), (np.array([0.045]),))], bench.nominal.starts, hold=True)[0]
    for name, value in (("SEEN", 0.15), ("CLEAR", np.inf), ("LOUD", np.inf)):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.adequacy.{name}", value)
    tuned = (bench.effect("constant_force"),) * corrections
    part = omnibus(bench.shooting, most).excess / bench.shooting.dof
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.A_LITTLE", little * part)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge._split", lambda *_: ([effect], tuned))
    judged = judge(bench.shooting, selection(bench, most))
    assert 0.04 < judged.unexplained < 0.15
    assert judged.verdict == verdict


def test_much_of_the_rest_is_named_however_little_of_the_whole_where_nothing_was_tuned(bench, monkeypatch) -> None:
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.judge.is_certain", lambda *_, **__: True
    )  # the second is all made up
    effects = (bench.effect("constant_force"), bench.effect("viscous_friction"))
    both = bench.shooting.fit([(effects, (np.array([0.0]), np.array([0.05])))], bench.nominal.starts)[0]
    nominal = dataclasses.replace(bench.nominal, chi2=1e9)
    one = dataclasses.replace(bench.fit("viscous_friction", 0.05), chi2=4.0 * both.chi2)
    other = dataclasses.replace(bench.fit("constant_force", 0.01), chi2=5.0 * both.chi2)
    names = {}
    for scale, tuned in ((1.0, ()), (5.0, ()), (5.0, (bench.effect("actuator_gain", "actuator:drive"),))):
        monkeypatch.setattr(
            "torch_activegp.diagnosis.selection.judge._split", lambda *_, tuned=tuned: ([*effects], tuned)
        )
        score = Score(bench.shooting.samples, 20, scale, 1e9 if scale > 1 else 1e3)
        judged = judge(bench.shooting, Selection(nominal, [nominal, both, one, other], score))
        names[scale, bool(tuned)] = [effect.name for effect in judged.named]
        assert set(judged.retuned) == {*tuned, *effects} - set(judged.named)
    strong = ["viscous_friction"]
    assert names == {(1.0, False): strong, (5.0, False): [*strong, "constant_force"], (5.0, True): strong}


def test_a_friction_behind_a_tuning_may_be_one_of_two_levels(bench, monkeypatch) -> None:
    dry, wet = bench.effect("coulomb_friction"), bench.effect("viscous_friction")
    (both,) = bench.shooting.fit([((dry, wet), (np.array([0.005]), np.array([0.05])))], bench.nominal.starts)
    two_sided = dataclasses.replace(bench.fit("asymmetric_friction", 0.02, 0.02), values=(np.array([0.05, 0.07]),))
    for tuned in ((wet,), ()):
        monkeypatch.setattr("torch_activegp.diagnosis.selection.judge._split", lambda *_, tuned=tuned: ([dry], tuned))
        monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.is_certain", lambda *_, **__: True)
        chosen = selection(bench, dataclasses.replace(both, chi2=0.9 * both.chi2), two_sided)
        assert chosen.best.effects == both.effects
        judged = judge(bench.shooting, chosen)
        assert judged.named == (dry,)
        assert (two_sided.effects[0].key in judged.ties[0]) is bool(tuned)


@pytest.mark.parametrize(
    ("dry", "load", "tuning", "named"),
    [
        (0.1, -0.05, True, {"coulomb_friction"}),
        (0.1, 0.05, True, {"coulomb_friction", "payload_mass"}),
        (-0.1, 0.05, True, {"coulomb_friction", "payload_mass"}),  # too much friction is a finding
        (None, -0.05, True, {"payload_mass"}),  # a tuning of what hides nothing is none
        (0.1, -0.05, False, {"coulomb_friction", "payload_mass", "viscous_friction"}),
    ],
)
def test_a_mass_that_is_too_much_beside_a_tuning_was_tuned(bench, monkeypatch, dry, load, tuning, named) -> None:
    values = {
        bench.effect("coulomb_friction"): dry,
        bench.effect("viscous_friction"): 0.01,
        bench.effect("payload_mass", "body:rod"): load,
    }
    values = {effect: np.array([value]) for effect, value in values.items() if value is not None}
    best = dataclasses.replace(
        bench.fit("viscous_friction", 0.05), effects=tuple(values), values=tuple(values.values())
    )
    asked = []
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.judge.is_a_tuning", lambda *some: asked.append(some[2]) or tuning
    )
    monkeypatch.setattr(Selection, "best", best)
    monkeypatch.setattr(Selection, "needs_more_than", lambda *_: False)
    found, beside = _split(bench.shooting, selection(bench, best), ())
    assert {effect.name for effect in found} == named
    assert {*found, *beside} == set(values)
    assert [[effect.name for effect in some] for some in asked] == [["viscous_friction"]]  # the mass makes none


@pytest.mark.parametrize("tunable", [True, False])
def test_another_form_of_what_may_have_been_tuned_was_tuned_too(bench, monkeypatch, tunable: bool) -> None:
    """Of a dry friction that the model has: as soft as it is there."""
    firm = dataclasses.replace(bench.effect("coulomb_friction"), tunable=tunable)
    soft, load = dataclasses.replace(firm, variant="soft", tunable=False), bench.effect("payload_mass", "body:rod")
    best = dataclasses.replace(bench.nominal, effects=(soft, load), values=(np.array([-0.01]), np.array([0.05])))
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.is_a_tuning", lambda *_: True)
    monkeypatch.setattr(Selection, "best", best)
    monkeypatch.setattr(Selection, "needs_more_than", lambda *_: False)
    chosen = dataclasses.replace(selection(bench, best), tunable=(firm,))
    assert _split(bench.shooting, chosen, ()) == (([load], (soft,)) if tunable else ([soft, load], ()))


@pytest.mark.parametrize(("part", "verdict"), [(0.9, "unknown"), (1.1, "named")])
def test_as_many_names_as_are_tried_may_leave_a_little_noise(bench, monkeypatch, part, verdict) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.MAX_EFFECTS", 1)
    some = (bench.effect("viscous_friction"),), (np.array([0.045]),)
    (close,) = bench.shooting.fit([some], bench.nominal.starts, hold=True)
    left = omnibus(bench.shooting, close).excess / bench.shooting.dof
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.SOME_NOISE", part * left)
    judged = judge(bench.shooting, selection(bench, close))
    assert 0.04 < judged.unexplained < 0.15
    assert judged.verdict == verdict


@pytest.mark.parametrize(("names", "verdict"), [(2, "unknown"), (3, "named")])
def test_what_may_be_nothing_is_not_named_and_counts_among_those_that_leave_too_much(
    bench, monkeypatch, names, verdict
) -> None:
    effects = (bench.effect("viscous_friction"), bench.effect("constant_force"))
    some = bench.shooting.fit([(effects, (np.array([0.045]), np.array([0.0])))], bench.nominal.starts, hold=True)[0]
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.LEAST_SHARE", -1.0)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.adequacy.MAX_EFFECTS", names)
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.judge.is_certain", lambda *args, **_: effects[0] in args[-1]
    )
    judged = judge(bench.shooting, selection(bench, some))
    assert (judged.named, judged.retuned) == (effects[:1], effects[1:])
    assert 0.04 < judged.unexplained < 0.15
    assert judged.verdict == verdict


def test_a_limit_that_the_model_has_anyway_is_fitted_along(bench, monkeypatch) -> None:
    effects = (bench.effect("viscous_friction"), bench.effect("constant_force"))
    some = bench.shooting.fit([(effects, (np.array([0.05]), np.array([0.01])))], bench.nominal.starts, hold=True)[0]
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.LEAST_SHARE", -1.0)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.is_certain", lambda *_, **__: True)
    assert judge(bench.shooting, selection(bench, some)).named == effects
    own = "torch_activegp.diagnosis.selection.judge.is_own_limit"
    monkeypatch.setattr(own, lambda model, effect, values: effect is effects[1])
    judged = judge(bench.shooting, selection(bench, some))
    assert (judged.named, judged.retuned) == (effects[:1], effects[1:])


@pytest.mark.parametrize(("visible", "verdict"), [(1e-3, "unknown"), (1e9, "none")])
def test_the_only_name_is_none_where_it_may_be_nothing(bench, monkeypatch, visible, verdict) -> None:
    """A lift that sticks, as its model: an armature gained 260 in chi2 by initial states, and may be zero."""
    wet = bench.fit("viscous_friction", 0.05)
    assert judge(bench.shooting, selection(bench, wet)).named == wet.effects
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.is_certain", lambda *_, alone=False: not alone)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE", visible)
    judged = judge(bench.shooting, selection(bench, wet))
    assert (judged.verdict, judged.named, judged.retuned, judged.fit) == (verdict, (), (), bench.nominal)
    assert judged.unexplained == float(verdict == "unknown")


@pytest.mark.parametrize(("least", "verdict"), [(1e-3, "unknown"), (1e9, "none")])
def test_more_must_be_left_without_a_name_where_a_filter_of_the_noise_cannot_be_seen(
    bench, monkeypatch, least, verdict
) -> None:
    segments = dataclasses.replace(bench.segments, dt=2.0 * bench.segments.dt)
    shooting = dataclasses.replace(bench.shooting, segments=segments)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE_UNSEEN", least)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.rises", lambda shooting, fit: False)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE", 1e-4)
    alone = Selection(bench.nominal, [bench.nominal], Score(shooting.samples, 20, 1.0))
    assert judge(shooting, alone).verdict == verdict


@pytest.mark.parametrize(("rising", "verdict"), [(True, "unknown"), (False, "none")])
def test_what_no_filter_makes_is_seen_where_a_filter_cannot_be(bench, monkeypatch, rising: bool, verdict: str) -> None:
    segments = dataclasses.replace(bench.segments, dt=2.0 * bench.segments.dt)
    shooting = dataclasses.replace(bench.shooting, segments=segments)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE_UNSEEN", 1e9)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE_IN_COLOUR", 1e-4)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.rises", lambda shooting, fit: rising)
    alone = Selection(bench.nominal, [bench.nominal], Score(shooting.samples, 20, 1.0))
    assert judge(shooting, alone).verdict == verdict


@pytest.mark.parametrize(
    ("coming", "least", "verdict"), [(True, 0.1, "unknown"), (False, 0.1, "none"), (True, 1e9, "none")]
)
def test_what_comes_and_goes_is_no_noise_where_its_level_is_not_known(
    bench, monkeypatch, coming, least, verdict
) -> None:
    segments = dataclasses.replace(bench.segments, dt=2.0 * bench.segments.dt)
    shooting = dataclasses.replace(bench.shooting, segments=segments)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE_UNSEEN", 1e9)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.VISIBLE_SOMEWHERE", least)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.rises", lambda shooting, fit: False)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.stands_out", lambda *_: False)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.comes_and_goes", lambda *_: coming)
    alone = Selection(bench.nominal, [bench.nominal], Score(shooting.samples, 20, 1.0))
    assert judge(shooting, alone).verdict == verdict


@pytest.mark.parametrize(("bar", "verdict"), [(100.0, "named"), (1e6, "none")])
def test_names_that_gain_much_are_kept_before_what_may_be_noise(bench, monkeypatch, bar: float, verdict: str) -> None:
    from torch_activegp.diagnosis.selection import judge as module

    monkeypatch.setattr(module, "_visible", lambda shooting, fit, left: False)
    monkeypatch.setattr(module, "leaves_much", lambda *_: False)
    monkeypatch.setattr(module, "least_gain", lambda shooting, best: bar)
    wet = bench.fit("viscous_friction", 0.05)
    part = dataclasses.replace(wet, chi2=wet.chi2 + 0.4 * (bench.nominal.chi2 - wet.chi2))
    left = dataclasses.replace(omnibus(bench.shooting, bench.nominal), excess=part.chi2 - wet.chi2)
    monkeypatch.setattr(module, "omnibus", lambda shooting, fit: left)
    judged = judge(bench.shooting, selection(bench, part))
    assert (judged.verdict, judged.unexplained) == (verdict, pytest.approx(0.4 * (verdict == "named"), abs=0.01))
    with monkeypatch.context() as many:
        many.setattr(module, "MANY", 1)
        assert judge(bench.shooting, selection(bench, part)).verdict == "none"
    monkeypatch.setattr(
        module, "_split", lambda shooting, chosen, rivals, within: (part.effects, (bench.effect("linear_spring"),))
    )
    assert judge(bench.shooting, selection(bench, part)).verdict == "none"


def test_a_weak_name_that_leaves_much_in_what_passes_for_noise_is_none(bench, monkeypatch) -> None:
    from torch_activegp.diagnosis.selection import judge as module

    monkeypatch.setattr(module, "_visible", lambda shooting, fit, left: False)
    wet = bench.fit("viscous_friction", 0.05)
    total, known = bench.nominal.chi2 - wet.chi2, omnibus(bench.shooting, wet)
    cases = [
        (60.0, 0.3, 0.05, "none"),
        (60.0, 0.1, 0.05, "named"),
        (160.0, 0.3, 0.05, "named"),
        (60.0, 0.3, 0.5, "named"),
    ]
    for gained, share, p_value, verdict in cases:
        found = selection(bench, wet)
        found.score = dataclasses.replace(found.score, material=0.0, scale=total / gained)
        left = dataclasses.replace(known, p_value=p_value, excess=share / (1.0 - share) * total)
        monkeypatch.setattr(module, "omnibus", lambda shooting, fit, left=left: left)
        assert judge(bench.shooting, found).verdict == verdict


def test_a_slight_colour_of_the_noise_makes_no_set_inadequate(bench, monkeypatch) -> None:
    """Half of what is missing was explained, and what is left is correlated: physics, or a filtered encoder's noise."""
    fit = bench.fit("quadratic_drag", 0.02)
    found = selection(bench, fit)
    plain = judge(bench.shooting, found)
    assert plain.verdict == "unknown"
    seen = []

    def louder(shooting, best):
        seen.append(best)
        return NoiseModel(100.0 * shooting.noise.scale, shooting.noise.colour)

    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.recoloured", louder)
    judged = judge(bench.shooting, found)
    assert seen == [found.best]
    assert judged.verdict == "named"
    assert judged.unexplained < plain.unexplained


@pytest.mark.parametrize(
    ("left", "was", "verdict"),
    [(10.0, 20.0, "unknown"), (10.0, 1000.0, "named"), (1.9, 3.0, "named")],
    ids=["much", "little of the mismatch", "little of the noise"],
)
def test_what_is_too_quick_for_a_force_in_bins_is_left_all_the_same(bench, monkeypatch, left, was, verdict) -> None:
    """A tyre's rim on a spring, which no recording held, was a gap that left 18 times the noise of 32."""
    dof, wet = bench.shooting.dof, bench.fit("viscous_friction", bench.viscous)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.judge.omnibus", lambda *_: Omnibus(0.0, 1.0))
    nominal = dataclasses.replace(bench.nominal, chi2=was * dof)
    best = dataclasses.replace(wet, chi2=left * dof)
    chosen = Selection(nominal, [nominal, best], Score(bench.shooting.samples, 20, left))
    judged = judge(bench.shooting, chosen)
    assert judged.verdict == verdict
    assert judged.white is (verdict == "named")
    assert judged.unexplained == pytest.approx((left - 1.0) / (was - 1.0) if verdict == "unknown" else 0.0)


@pytest.mark.parametrize(("faintest", "verdict"), [(0.9, "named"), (1.1, "unknown")])
def test_what_takes_hardly_any_of_the_noise_away_is_no_name(bench, monkeypatch, faintest, verdict) -> None:
    found = selection(bench, bench.fit("viscous_friction", 0.05))
    gained = (bench.nominal.chi2 - found.best.chi2) / bench.shooting.dof
    monkeypatch.setattr(module, "FAINTEST", faintest * gained)
    judged = judge(bench.shooting, found)
    assert (judged.verdict, bool(judged.named)) == (verdict, verdict == "named")
