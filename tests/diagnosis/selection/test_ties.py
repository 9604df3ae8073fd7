from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import ties as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.ties import (
    as_one,
    as_part,
    as_two,
    is_as_late,
    is_one_way,
    ties_of,
    told_apart_by,
)
from torch_activegp.diagnosis.shooting.score import TIE, Score


def test_a_friction_of_two_levels_may_be_one_level_and_a_push(bench) -> None:
    rich = next(e for e in bench.effects if e.name == "asymmetric_friction" and "coulomb_friction" in e.covers)
    dry, push, wet = (bench.effect(name) for name in ("coulomb_friction", "constant_force", "viscous_friction"))
    levels = (np.array([0.004, 0.006]), np.array([0.05]))
    one = bench.shooting.fit([((rich, wet), levels)], bench.nominal.starts)[0]
    two = dataclasses.replace(
        one, effects=(dry, push, wet), values=(np.array([0.005]), np.array([0.001]), one.values[1])
    )
    both = {dry.key, push.key}
    for chi2, names in ((one.chi2, both), (0.99 * one.chi2, both), (1.01 * one.chi2, set())):
        rivals = [(one, 0.0, 1.0), (dataclasses.replace(two, chi2=chi2), 20.0, 0.0)]
        assert set(as_two(rivals, one, rich)) == names
        assert as_two(rivals, one, wet) == ()
    bias = bench.effect("actuator_bias", "actuator:drive")
    same = [(one, 0.0, 1.0), (dataclasses.replace(two, chi2=one.chi2), 20.0, 0.0)]
    tunable = [bias, wet, dataclasses.replace(push, target="joint:knee")]
    assert set(as_two(same, one, rich, tunable)) == {*both, bias.key}  # a bias pushes as a force does
    assert as_two(same[:1], one, rich, tunable) == ()


@pytest.mark.parametrize(
    ("sure", "worse", "held", "back", "tied"),
    [
        (9.0, 5.0, False, 0.06, True),
        (11.0, 5.0, False, 0.06, False),
        (11.0, 5.0, False, 0.08, True),  # and differs by half
        (9.0, 7.0, False, 0.08, False),
        (9.0, 11.0, True, 0.06, True),
        (9.0, 13.0, True, 0.08, False),
    ],
)
def test_a_law_is_not_told_from_those_that_contain_it_where_it_is_weak_or_these_differ_and_fit(
    bench, monkeypatch, sure: float, worse: float, held: bool, back: float, tied: bool
) -> None:
    monkeypatch.setattr(module, "certainty", lambda *_: sure**2)
    laws = [e for e in bench.effects if e.name == "asymmetric_friction"]
    dry, rich = (next(e for e in laws if name in e.covers) for name in ("coulomb_friction", "viscous_friction"))
    wet, push, drag = (bench.effect(name) for name in ("viscous_friction", "constant_force", "quadratic_drag"))
    one, two = np.array([0.05]), np.array([0.05, back])
    begin = dataclasses.replace(bench.nominal, effects=(wet, push), values=(one, one))

    def beside(*effects, chi2: float = 0.0, values=two):
        return dataclasses.replace(begin, effects=effects, values=(values, *[one] * 2)[: len(effects)], chi2=chi2)

    law, worst = beside(rich, push, chi2=begin.chi2 + worse), begin.chi2 + 1e3
    others = [beside(dry, push, chi2=begin.chi2 + 0.5), beside(rich, push, drag), beside(drag, push, values=one)]
    others += [beside(rich, drag, chi2=begin.chi2)]  # in the force's place too
    score = Score(bench.shooting.samples, 60, 1.0)
    fits, apart = [begin, *others, beside(rich, push, chi2=worst)], [law] if held else []
    selection = Selection(bench.nominal, [*fits, *([] if held else [law])], score, held=apart)
    monkeypatch.setattr(Selection, "best", begin)
    assert as_part(bench.shooting, selection, wet) == ((rich.key,) if tied else ())
    assert as_part(bench.shooting, selection, push) == ()
    bare = beside(rich, chi2=law.chi2)
    without = dataclasses.replace(selection, fits=[begin, *([] if held else [bare])], held=[bare] if held else [])
    assert as_part(bench.shooting, without, wet) == ()
    assert as_part(bench.shooting, without, wet, frozenset({push.key})) == (
        (rich.key,) if tied else ()
    )  # which is not named
    selection.fits, selection.held = fits, ()
    assert as_part(bench.shooting, selection, wet) == ()
    selection.score = dataclasses.replace(score, scale=1e3)
    assert as_part(bench.shooting, selection, wet) == ((rich.key,) if sure < 10.0 or back > 0.075 else ())


@pytest.mark.parametrize(("own", "tied"), [(0.0, False), (0.3, True)])
def test_a_static_excess_is_compared_with_all_dry_friction_that_is_there(bench, monkeypatch, own, tied: bool) -> None:
    """Of a model that has 0.2 too much of 0.3, half of the rest is another law."""
    monkeypatch.setattr(module, "certainty", lambda *_: 1e6)
    dry = dataclasses.replace(bench.effect("coulomb_friction"), nominal_loss=own)
    law = dataclasses.replace(bench.effect("stribeck_friction"), nominal_loss=own)
    begin = dataclasses.replace(bench.nominal, effects=(dry,), values=(np.array([-0.2]),))
    other = dataclasses.replace(begin, effects=(law,), values=(np.array([-0.2, 0.05, 0.1]),))
    selection = Selection(bench.nominal, [begin], Score(bench.shooting.samples, 60, 1.0), held=[other])
    monkeypatch.setattr(Selection, "best", begin)
    monkeypatch.setattr(type(begin), "plausible", True)
    assert as_part(bench.shooting, selection, dry) == ((law.key,) if tied else ())


def test_one_level_and_a_tuned_push_may_be_a_friction_of_two_levels(bench) -> None:
    rich = next(e for e in bench.effects if e.name == "asymmetric_friction" and "coulomb_friction" in e.covers)
    dry, bias, wet = (
        bench.effect(*key)
        for key in (("coulomb_friction",), ("actuator_bias", "actuator:drive"), ("viscous_friction",))
    )

    def said(push=0.002, chi2=1.0, beside: tuple = (wet,), tuned=(wet, bias), also: tuple = (), law=rich) -> tuple:
        two = bench.nominal
        two = dataclasses.replace(
            two, effects=(dry, bias, wet), values=(np.array([0.005]), np.array([push]), np.array([0.05]))
        )
        values = (np.array([0.003, 0.007]), *(np.array([0.05]) for _ in beside))
        values = values if law is rich else (np.array([0.05]),) * (1 + len(beside))
        one = dataclasses.replace(two, effects=(law, *beside), values=values, chi2=chi2 * two.chi2)
        return as_one([(two, 0.0, 1.0), (one, 20.0, 0.0)], two, dry, tuned, also)

    assert said() == (rich.key,)
    assert said(beside=()) == (rich.key,)
    assert said(push=0.0005) == ()  # hardly a difference between the directions
    assert said(chi2=1.01) == ()
    assert said(beside=(bench.effect("quadratic_drag"),)) == ()
    assert said(tuned=(wet,)) == ()
    assert said(push=0.0005, also=(wet,)) == (rich.key,)  # the nominal's own bias may hold the push
    assert said(push=0.0005, also=(wet,), law=wet) == ()
    assert said(push=0.0005, also=(bias,)) == (rich.key,)
    assert said(push=0.0005, also=(dataclasses.replace(wet, target="joint:knee"),)) == ()


def test_all_that_stands_for_a_name_is_listed_once(bench) -> None:
    dry, two_sided = bench.fit("coulomb_friction", 0.05), bench.fit("asymmetric_friction", 0.02, 0.02)
    rivals = [(dry, 0.0, 0.6), (two_sided, 2.0, 0.4), (bench.nominal, 50.0, 0.0)]
    wet = dataclasses.replace(bench.effect("viscous_friction"))
    assert ties_of(rivals, dry, dry.effects[0], (wet,), (wet,)) == (two_sided.effects[0].key,)
    far = [(dry, 0.0, 1.0), (two_sided, 7.0, 0.0)]
    assert ties_of(far, dry, dry.effects[0], (), ()) == ()
    assert ties_of(far, dry, dry.effects[0], (), (), within=8.0) == (two_sided.effects[0].key,)


@pytest.mark.parametrize("tuned", [True, False])
def test_what_undoes_a_tuning_may_be_another_thing_in_a_set_that_says_the_same(bench, tuned: bool) -> None:
    """A push there, and a drive's bias here."""
    gravity, mass = bench.effect("gravity_error", "world"), bench.effect("payload_mass", "body:rod")
    push, bias = bench.effect("constant_force"), bench.effect("actuator_bias", "actuator:drive")
    wet = bench.effect("viscous_friction")
    one, two, three = (
        dataclasses.replace(bench.nominal, effects=effects, values=(np.ones(1),) * len(effects))
        for effects in ((mass, push, wet), (gravity, bias, wet), (gravity, bias))
    )
    undoes = (push, wet) if tuned else ()
    for rivals in ([(one, 0.0, 0.5), (two, 0.0, 0.5)], [(one, 0.0, 0.5), (three, 0.0, 0.3), (two, 0.0, 0.2)]):
        told = ties_of(rivals, one, mass, undoes, undoes, tunable=(push, bias, wet))
        assert told == ((gravity.key,) if tuned else ())
    assert ties_of([(one, 0.0, 0.5), (two, 9.0, 0.5)], one, mass, undoes, undoes, tunable=(push, bias, wet)) == ()
    stands_in = dataclasses.replace(one, effects=(bias, push, wet))  # as well as the mass does
    assert ties_of([(one, 0.0, 0.5), (stands_in, 0.0, 0.5)], one, mass, undoes, undoes, tunable=(push, bias, wet)) == (
        bias.key,
    )


def test_sets_are_told_apart_by_more_where_the_machine_strikes_something(bench, monkeypatch) -> None:
    assert told_apart_by(bench.shooting, bench.nominal) == TIE
    stopped = dataclasses.replace(bench.nominal, effects=(bench.effect("joint_stop"),))
    assert told_apart_by(bench.shooting, stopped) > 2.0 * TIE
    for share, apart in ((6, False), (300, True)):  # now and then; a cart on its wheels strikes nothing
        touches = np.arange(300) < share
        monkeypatch.setattr(
            "torch_activegp.diagnosis.simulation.touching.poses_that_touch", lambda *_, t=touches: (t, t)
        )
        assert (told_apart_by(bench.shooting, bench.nominal) == TIE) == apart


@pytest.mark.parametrize("way", ["one", "two controls", "a force"])
def test_a_delay_is_one_law_at_either_end_of_a_machine_with_one_way_through_it(bench, way: str) -> None:
    """However they score: their fits differ by time steps alone. But not where another input comes when it comes."""
    drive, encoder = bench.effect("actuator_delay", "actuator:drive"), bench.effect("sensor_delay", "sensor:hip")
    wet, bias = bench.effect("viscous_friction"), bench.effect("sensor_bias", "sensor:hip")
    values = np.array([0.008]), np.array([0.05])
    one = dataclasses.replace(bench.nominal, effects=(encoder, wet), values=values)
    other = dataclasses.replace(one, effects=(drive, wet), chi2=1.01 * one.chi2)
    runs = [
        dataclasses.replace(
            run,
            control=np.hstack([run.control] * 2) if way == "two controls" else run.control,
            force=run.force + (way == "a force"),
        )
        for run in bench.segments.runs
    ]
    shooting = dataclasses.replace(bench.shooting, segments=dataclasses.replace(bench.segments, runs=tuple(runs)))
    assert is_one_way(shooting) == (way == "one")
    rivals = [(one, 0.0, 1.0), (other, 9.0, 0.0)]
    assert ties_of(rivals, one, encoder, (), (), is_one_way(shooting)) == ((drive.key,) if way == "one" else ())
    assert ties_of(rivals, one, wet, (), (), True) == ()
    more = dataclasses.replace(one, effects=(encoder, wet, bias), values=(*values, np.array([0.001])))
    beside = [(more, 0.0, 1.0), (other, 9.0, 0.0)]
    assert ties_of(beside, more, encoder, (), (), True) == ()
    assert ties_of(beside, more, encoder, (bias,), (), True) == (drive.key,)  # a bias that is not named
    lag = dataclasses.replace(one, effects=(bench.effect("actuator_lag", "actuator:drive"), wet))
    for distance, tied in ((1.0, {drive.key, encoder.key}), (9.0, set())):  # a lag that a delay stands for as well
        rivals = [(lag, 0.0, 1.0), (other, distance, 0.0), (one, 9.0, 0.0)]
        assert set(ties_of(rivals, lag, lag.effects[0], (), (), True)) == tied
    assert is_as_late(one, other) and is_as_late(other, one)
    assert not is_as_late(lag, other)
    assert not is_as_late(one, dataclasses.replace(other, effects=(bias, wet)))
    assert not is_as_late(one, dataclasses.replace(other, chi2=1.1 * one.chi2))
