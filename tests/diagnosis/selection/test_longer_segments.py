"""A pendulum with viscous friction that its model lacks, in segments so short that any drag is close."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest

from tests.diagnosis.conftest import make_bench
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.lengths import uncut
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection import explain
from torch_activegp.diagnosis.selection.explain import _OnAllData
from torch_activegp.diagnosis.selection.longer_segments import in_longer_segments
from torch_activegp.diagnosis.selection.search import select
from torch_activegp.diagnosis.selection.start import WHOLE, Start

WRONG = "quadratic_drag"


@pytest.fixture(scope="module")
def numerics(bench):
    return Numerics.of(bench.machine, 1)


@pytest.fixture
def begun(bench, numerics):
    """What naming begins from in segments of a quarter of a second, by the set of one effect."""

    def start(name: str, value: float) -> Start:
        segments = cut(bench.machine.fit, 0.25, 0.1)
        shooting = dataclasses.replace(bench.shooting, engine=numerics.fine, segments=segments)
        nominal = shooting.fit([((), ())], shooting.engine.starts(segments))[0]
        first = shooting.fit([((bench.effect(name),), (np.array([value]),))], nominal.starts)[0]
        return Start(numerics.fine, shooting, nominal, [], first, frozenset(), shooting.noise)

    return start


def asked(bench, numerics, start: Start, **how) -> Start | None:
    return in_longer_segments(bench.machine, numerics, start, (start.first, [], frozenset()), **how)


def test_a_wrong_name_shows_in_longer_segments(bench, numerics, begun) -> None:
    start = dataclasses.replace(begun(WRONG, 0.02), noise=NoiseModel.white(np.array([1.0])))
    assert start.first.chi2 < 1.1 * start.shooting.dof  # any drag does in these
    longer = asked(bench, numerics, start)
    assert longer is not None
    assert longer.shooting.segments.size == uncut(bench.machine).size  # the shortest in which it shows
    assert longer.first.effects == start.first.effects
    assert longer.first.chi2 > 3.0 * longer.shooting.dof
    assert longer.nominal.chi2 > longer.first.chi2
    assert longer.noise is start.shooting.noise  # by which the numerics were chosen now


def test_segments_stay_as_they_are_where_the_right_name_leaves_noise(bench, numerics, begun) -> None:
    assert asked(bench, numerics, begun("viscous_friction", 0.05)) is None


def test_segments_are_no_longer_than_asked_for(bench, numerics, begun, monkeypatch) -> None:
    assert asked(bench, numerics, begun(WRONG, 0.02), times=(2,)) is None  # they would be too few
    monkeypatch.setattr("torch_activegp.diagnosis.selection.longer_segments._FEWEST", 2)
    longer = asked(bench, numerics, begun(WRONG, 0.02), times=(2,))
    assert longer is not None
    assert longer.shooting.segments.size == len(bench.machine.fit)


@pytest.mark.parametrize("far", [True, False])
def test_nothing_is_asked_of_sets_that_leave_much(bench, numerics, begun, monkeypatch, far: bool) -> None:
    """What they leave of the noise, or of the mismatch, shows already."""
    start = begun(WRONG, 0.02)
    if far:
        start = dataclasses.replace(start, first=dataclasses.replace(start.first, chi2=2.1 * start.shooting.dof))
    else:
        small = dataclasses.replace(start.nominal, chi2=start.first.chi2 + 1.0)
        start = dataclasses.replace(start, nominal=small)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.longer_segments.followed_by", None)
    assert asked(bench, numerics, start) is None


def test_what_is_weak_shows_in_the_longest_segments(bench, numerics, begun, monkeypatch) -> None:
    """Without any name; but for what leaves more than is close there, which is asked in the shortest."""
    start = begun(WRONG, 0.02)
    start = dataclasses.replace(start, first=start.nominal)
    longer = asked(bench, numerics, start)
    assert longer is not None
    assert longer.shooting.segments.size == uncut(bench.machine).size
    monkeypatch.setattr("torch_activegp.diagnosis.selection.longer_segments._FEWEST", 2)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.longer_segments._CLOSE", 1e4)
    longest = asked(bench, numerics, start)
    assert longest is not None
    assert longest.shooting.segments.size == len(bench.machine.fit)
    assert longest.first.effects == ()
    assert longest.first.chi2 / longest.shooting.dof > longer.first.chi2 / longer.shooting.dof > 10.0


def test_noise_alone_is_as_loud_in_any_segments() -> None:
    bench = make_bench("none")
    fine = Numerics.of(bench.machine, 1)
    shooting = dataclasses.replace(bench.shooting, engine=fine.fine)
    start = Start(fine.fine, shooting, bench.nominal, [], bench.nominal, frozenset(), shooting.noise)
    assert asked(bench, fine, start) is None


def test_what_a_steep_filter_took_is_not_known_over_longer_segments(bench, numerics, begun) -> None:
    filtered = [dataclasses.replace(run, filters=(SteepFilter(0.2, 1e-3, (2, 1)),)) for run in bench.machine.fit]
    start, machine = begun(WRONG, 0.02), dataclasses.replace(bench.machine, fit=filtered)
    assert in_longer_segments(machine, numerics, start, (start.first, [], frozenset())) is None


def test_where_something_touches_four_seconds_are_too_long(bench, numerics, begun, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.selection.longer_segments._FEWEST", 2)
    monkeypatch.setattr("torch_activegp.diagnosis.selection.longer_segments._CLOSE", 1e4)
    touching = copy.copy(numerics)
    object.__setattr__(touching, "stiff", True)
    start, sizes = begun(WRONG, 0.02), []
    monkeypatch.setattr(
        "torch_activegp.diagnosis.selection.longer_segments.followed_by",
        lambda whole, *_: sizes.append(whole.segments.size),
    )
    for some, asked_of in ((numerics, [2, 2, 4]), (touching, [2, 4])):  # of runs of two seconds
        sizes.clear()
        assert asked(bench, some, start) is None
        assert sizes == asked_of


@pytest.mark.parametrize("found", [False, True])
def test_what_grows_with_time_and_has_no_name_is_left_as_it_was(bench, numerics, begun, found: bool) -> None:
    """As a random force does; a name that takes half of it is taken."""
    start = begun(WRONG, 0.02)
    start = dataclasses.replace(start, first=start.nominal)
    names = ["constant_force", *(["viscous_friction"] if found else [])]
    work = _OnAllData(bench.machine, numerics, [bench.effect(name) for name in names], lambda _: None)
    ended, selection, as_begun = work._in_any(start)
    assert as_begun != found
    assert (ended.shooting is start.shooting) != found
    assert [effect.name for effect in selection.best.effects] == names[1:]


def test_a_set_that_cannot_be_simulated_for_longer_changes_nothing(bench, numerics, begun, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.selection.longer_segments.followed_by", lambda *_: None)
    assert asked(bench, numerics, begun(WRONG, 0.02)) is None


def test_naming_goes_on_in_longer_segments(bench, numerics, begun, monkeypatch) -> None:
    """As deep as it would have gone in the short ones."""
    start, told, depths = begun(WRONG, 0.02), list[str](), []
    monkeypatch.setattr(explain, "select", lambda *given: depths.append(given[-1]) or select(*given))
    some = [bench.effect(name) for name in (WRONG, "viscous_friction")]
    start, selection = _OnAllData(bench.machine, numerics, some, told.append).name(start, start.noise)
    assert told[:2] == ["naming on all data", "naming in longer segments"]
    assert depths[0] == WHOLE
    assert start.shooting.segments.size == uncut(bench.machine).size
    assert [effect.name for effect in selection.best.effects] == ["viscous_friction"]
    assert selection.best.chi2 < 1.1 * start.shooting.dof
