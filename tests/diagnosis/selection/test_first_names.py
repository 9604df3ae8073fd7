from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.noise.floor import noise_floor
from torch_activegp.diagnosis.preparation.lengths import nominal_in_brief
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection import explain as whole
from torch_activegp.diagnosis.selection import first_names as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import explain
from torch_activegp.diagnosis.selection.first_names import Naming, in_brief_pieces
from torch_activegp.diagnosis.shooting.score import Score


def test_brief_pieces_have_no_lead_and_cover_everything_once(bench) -> None:
    found = nominal_in_brief(bench.machine, Numerics.of(bench.machine, 1), noise_floor(bench.machine.fit))
    assert found is not None
    segments = found.segments
    lengths = segments.dt[:, 0] * np.diff(segments.scored, axis=1)[:, 0]
    assert lengths.max() < 0.13
    np.testing.assert_array_equal(segments.scored[:, 0], segments.first)
    assert segments.counts.sum() == sum(run.recorded.sum() for run in segments.runs)


def test_rows_far_apart_make_no_brief_pieces(bench) -> None:
    slow = [dataclasses.replace(run, time=4.0 * run.time) for run in bench.machine.fit]
    machine = dataclasses.replace(bench.machine, fit=slow)
    assert nominal_in_brief(machine, Numerics.of(machine, 1), noise_floor(bench.machine.fit)) is None


@pytest.mark.parametrize(("most", "named"), [(1e9, True), (0.5, False)])
def test_names_in_brief_pieces_that_leave_too_much_lead_nowhere(bench, monkeypatch, most, named) -> None:
    """No noise leaves half of itself: what a machine remembers for longer than a piece is not on the list."""
    for name, value in (("_ENOUGH", 1.0), ("FEWEST", 1.0), ("_LEADS", most)):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", value)
    noise = noise_floor(bench.machine.fit)
    effects = [bench.effect("viscous_friction")]
    found = in_brief_pieces(bench.machine, Numerics.of(bench.machine, 1), noise, effects, lambda _: None)
    assert found is not None
    assert bool(found.sets) == named
    assert [[effect.key for effect in some] for some, _ in found.aside] == [[effects[0].key]] * (not named)


@pytest.mark.parametrize(("times", "tried"), [(9.9, False), (10.1, True)])
def test_what_was_put_aside_is_tried_where_all_since_leaves_as_much(bench, times: float, tried: bool) -> None:
    sets = [((bench.effect("viscous_friction"),), (np.array([0.05]),))]
    naming = Naming(bench.engine, bench.shooting, bench.nominal, bench.nominal, aside=sets)
    judged = dataclasses.replace(bench.nominal, chi2=times * bench.shooting.dof)
    assert naming.yet_to_try(judged, bench.shooting) == (sets if tried else [])


def test_what_was_put_aside_and_is_part_of_what_was_found_is_not_tried_again(bench) -> None:
    wet, dry, both = (bench.effect(name) for name in ("viscous_friction", "coulomb_friction", "asymmetric_friction"))
    one = np.array([0.05])
    sets = [((wet,), (one,)), ((dry,), (one,)), ((wet, dry), (one, one))]
    naming = Naming(bench.engine, bench.shooting, bench.nominal, bench.nominal, aside=sets)
    for found, left in (((wet,), sets[1:]), ((both,), sets[1:]), ((wet, dry), []), ((), sets)):
        judged = dataclasses.replace(bench.nominal, chi2=20.0 * bench.shooting.dof, effects=found)
        less = [((dry,), (one,)), ((wet,), (one,))] if left[-1:] == sets[2:] else []  # each without one of its names
        assert naming.yet_to_try(judged, bench.shooting) == left + less
        failed = dataclasses.replace(judged, chi2=np.inf)
        assert naming.yet_to_try(failed, bench.shooting)[:3] == sets  # there is no such set
    two = next(e for e in bench.effects if e.name == "asymmetric_friction" and "coulomb_friction" in e.covers)
    other = dataclasses.replace(naming, aside=[((both,), (one,))])
    judged = dataclasses.replace(bench.nominal, chi2=20.0 * bench.shooting.dof, effects=(two,))
    assert other.yet_to_try(judged, bench.shooting) == other.aside  # another law of the same name


@pytest.mark.parametrize("far", [True, False])
def test_names_from_brief_pieces_lead_on_where_the_nominal_is_far_off(bench, monkeypatch, far) -> None:
    """They need not be the right ones: here the mismatch is too small for so brief a look."""
    monkeypatch.setattr(whole, "TOO_FAR", 1.0 if far else 1e9)
    for name in ("_ENOUGH", "FEWEST"):
        monkeypatch.setattr(f"torch_activegp.diagnosis.selection.first_names.{name}", 1.0)
    seen = []
    monkeypatch.setattr(whole, "in_brief_pieces", lambda *a: seen.append(in_brief_pieces(*a)) or seen[-1])
    stages: list[str] = []
    names = ("viscous_friction", "cubic_spring", "coulomb_friction")
    found = explain(bench.machine, [e for e in bench.effects if e.name in names], 1, stages.append)
    assert found.selection.best.keys == {("viscous_friction", "joint:hip")}
    assert ("naming in brief pieces" in stages) == far
    assert bool(seen) == far
    if far:
        assert seen[0].sets


@pytest.mark.parametrize(("cut", "scale", "vain"), [(True, 3.0, True), (True, 1.5, False), (False, 3.0, False)])
def test_a_long_search_that_leaves_much_was_in_vain(bench, monkeypatch, cut: bool, scale: float, vain: bool) -> None:
    score = Score(bench.shooting.samples, 10, scale)
    chosen = Selection(bench.nominal, [bench.nominal], score, cut_short=cut)
    monkeypatch.setattr(module, "select", lambda *_, **__: chosen)
    naming = Naming(bench.engine, bench.shooting, bench.nominal, bench.nominal)
    numerics = Numerics.of(bench.machine, 1)
    assert module.on_a_part(naming, numerics, bench.shooting.noise, [], lambda _: None).in_vain == vain


@pytest.mark.parametrize(
    ("vain", "scale", "most", "asked"),
    [
        (True, 3.0, np.inf, [True]),
        (False, 3.0, np.inf, [False]),
        (False, 1.0, np.inf, []),  # noise alone is left
        (True, 3.0, 10.0, []),  # in brief pieces
    ],
)
def test_what_strikes_is_sought_in_shorter_steps_where_something_is_left(
    bench, monkeypatch, vain: bool, scale: float, most: float, asked: list[bool]
) -> None:
    """And names go on from there, by the form of the model that agrees best behind it."""
    right, other = bench.fit("viscous_friction", bench.viscous), dataclasses.replace(bench.shooting)
    first = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 10, scale), cut_short=vain)
    later = Selection(bench.nominal, [bench.nominal, right], Score(bench.shooting.samples, 10, 1.0))
    selections, told, behind = [first, later], [], []
    monkeypatch.setattr(module, "select", lambda *_, **__: selections.pop(0))
    struck = right.effects, right.values
    monkeypatch.setattr(module, "in_short_steps", lambda *a: told.append(a[6]) or struck)
    chosen = bench.engine, other, bench.nominal, right
    monkeypatch.setattr(Numerics, "choose", lambda *a: behind.append(a[5]) or chosen)
    naming = Naming(bench.engine, bench.shooting, bench.nominal, bench.nominal)
    numerics, noise = Numerics.of(bench.machine, 1), bench.shooting.noise
    found = module.on_a_part(naming, numerics, noise, [], lambda _: None, most)
    assert told == asked
    assert behind == [[struck] for _ in asked]
    if asked:
        assert (found.shooting, found.judged, found.in_vain) == (other, right, False)
        assert found.best == frozenset(right.effects)
    else:
        assert found.in_vain == (vain and scale > 1.5)


def test_what_strikes_leads_on_only_where_it_fits_all_data(bench, monkeypatch) -> None:
    first = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 10, 3.0))
    monkeypatch.setattr(module, "select", lambda *_, **__: first)
    right = bench.fit("viscous_friction", bench.viscous)
    monkeypatch.setattr(module, "in_short_steps", lambda *_: (right.effects, right.values))
    failed = bench.engine, bench.shooting, bench.nominal, dataclasses.replace(right, chi2=np.inf)
    monkeypatch.setattr(Numerics, "choose", lambda *_: failed)
    naming = Naming(bench.engine, bench.shooting, bench.nominal, bench.nominal)
    numerics, noise = Numerics.of(bench.machine, 1), bench.shooting.noise
    assert not module.on_a_part(naming, numerics, noise, [], lambda _: None).best


@pytest.mark.parametrize("most", [True, False])
def test_numerics_are_not_chosen_behind_names_that_leave_most(bench, monkeypatch, most: bool) -> None:
    """And the search goes on from what it has compared."""
    monkeypatch.setattr(module, "leaves_most", lambda *_: most)
    for name, value in (("_ENOUGH", 1.0), ("FEWEST", 1.0), ("NOISE_ALONE", 0.0)):
        monkeypatch.setattr(module, name, value)
    calls: list[str] = []
    for owner, name in ((module, "select"), (module, "go_on"), (Numerics, "choose")):
        real = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *a, r=real, n=name, **k: calls.append(n) or r(*a, **k))
    naming = Naming(bench.engine, bench.shooting, bench.nominal, bench.nominal)
    effects = [bench.effect("coulomb_friction"), bench.effect("quadratic_drag")]
    numerics, noise = Numerics.of(bench.machine, 1), bench.shooting.noise
    found = module.on_a_part(naming, numerics, noise, effects, lambda _: None)
    assert calls == (["select", "go_on"] if most else ["select", "choose", "select"])
    assert found.sets


@pytest.mark.parametrize("odd", [True, False])
def test_names_that_all_data_contradict_are_sought_where_they_leave_most(bench, monkeypatch, odd: bool) -> None:
    """What shows in a few segments alone is not in a part that is spread evenly."""
    for name, value in (("_ENOUGH", 1.0), ("FEWEST", 2.0), ("NOISE_ALONE", 0.0), ("_ODD", 0.0 if odd else 1e9)):
        monkeypatch.setattr(module, name, value)
    monkeypatch.setattr(module, "leaves_most", lambda *_: False)
    asked: list[np.ndarray | None] = []
    real = module._part
    monkeypatch.setattr(module, "_part", lambda *a: asked.append(a[2] if len(a) > 2 else None) or real(*a))
    naming = Naming(bench.engine, bench.shooting, bench.nominal, bench.nominal)
    numerics, noise = Numerics.of(bench.machine, 1), bench.shooting.noise
    module.on_a_part(naming, numerics, noise, [bench.effect("viscous_friction")], lambda _: None)
    first, second = asked
    assert first is None
    assert (second is not None) == odd
    if second is not None:
        judged = bench.fit("viscous_friction", bench.viscous)
        np.testing.assert_allclose(second, judged.per_segment, rtol=0.05)
