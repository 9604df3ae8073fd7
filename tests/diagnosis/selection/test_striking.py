from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.against_a_stop import AT, STIFFNESS, struck_bench
from tests.diagnosis.conftest import Bench
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection import striking as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.striking import in_short_steps
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.effect import Effect


@pytest.fixture(scope="module")
def struck() -> Bench:
    return struck_bench()


@pytest.fixture(autouse=True)
def _in_time(monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.selection.striking._WORK", 4e5)


@pytest.fixture(scope="module")
def numerics(struck: Bench) -> Numerics:
    return Numerics.of(struck.machine, 1)


@pytest.fixture(scope="module")
def part(struck: Bench, numerics: Numerics) -> Shooting:
    """In the long steps of the cheap form."""
    return dataclasses.replace(struck.shooting, engine=numerics.coarse)


@pytest.fixture(scope="module")
def tried(struck: Bench) -> list[Effect]:
    stop = next(effect for effect in struck.effects if effect.strikes and effect.variant == "upper")
    return [struck.effect("viscous_friction"), stop]


@pytest.fixture(scope="module")
def found(part: Shooting) -> Selection:
    nominal = part.fit([((), ())], part.engine.starts(part.segments))[0]
    return Selection(nominal, [nominal], Score(part.samples, 10, 1.0))


def test_a_stop_is_found_in_shorter_steps_with_its_numbers(numerics, part, found, tried) -> None:
    stages: list[str] = []
    told = in_short_steps(numerics, numerics.given, part, part, found, tried, stages.append)
    assert told is not None
    form, whole, bare, judged = told
    assert form is whole.engine is numerics.finest
    assert form.steps_in(part.segments) > part.engine.steps_in(part.segments)
    assert [effect.name for effect in judged.effects] == ["joint_stop"]
    assert judged.values[0][[0, 2]] == pytest.approx([STIFFNESS, AT], rel=0.03)
    assert judged.chi2 < 0.1 * bare.chi2
    assert not bare.effects
    assert stages == ["testing what strikes in shorter time steps"]


def test_what_was_found_stays_where_it_leaves_less(struck, numerics, part, found, tried) -> None:
    other = dataclasses.replace(found.nominal, effects=(struck.effect("viscous_friction"),), values=(np.ones(1),))
    better = dataclasses.replace(found, fits=[found.nominal, dataclasses.replace(other, chi2=float(part.dof))])
    assert in_short_steps(numerics, numerics.given, part, part, better, tried, lambda _: None) is None


def test_it_is_asked_only_of_what_strikes_and_where_steps_can_be_shorter(numerics, part, found, tried) -> None:
    smooth = [effect for effect in tried if not effect.strikes]
    asked: list[str] = []
    assert in_short_steps(numerics, numerics.given, part, part, found, smooth, asked.append) is None
    short = dataclasses.replace(part, engine=numerics.finest)
    assert in_short_steps(numerics, numerics.given, short, short, found, tried, asked.append) is None
    assert asked == []


@pytest.mark.parametrize(("left", "taken"), [(0.3, False), (0.45, True)])
def test_what_short_steps_alone_gain_is_no_stops(numerics, part, found, tried, monkeypatch, left, taken) -> None:
    """What was found is fitted by them too: the stop must leave less than that."""
    push, stop = tried
    nominal = found.nominal

    def leaves(effects, part_of_it: float) -> Fit:
        values = tuple(effect.seeds[0] for effect in effects)
        return dataclasses.replace(nominal, effects=tuple(effects), values=values, chi2=part_of_it * nominal.chi2)

    known = dataclasses.replace(found, fits=[nominal, leaves([push], 0.5)])
    by = {(): 1.0, (push,): left, (stop,): 0.4}
    monkeypatch.setattr(module, "expand", lambda tried, *_: tried.add([leaves([stop], 0.4)]))
    monkeypatch.setattr(Shooting, "fit", lambda _, sets, *a, **k: [leaves(e, by[tuple(e)]) for e, _ in sets])
    told = in_short_steps(numerics, numerics.given, part, part, known, tried, lambda _: None)
    assert (told is not None) == taken


def test_a_fit_to_all_data_that_fails_is_none(numerics, part, found, tried, monkeypatch) -> None:
    real = Shooting.fit

    def fails(self, sets, *rest, **options):
        fits = real(self, sets, *rest, **options)
        both = [len(effects) for effects, _ in sets] == [0, 1]
        return [dataclasses.replace(fit, chi2=np.inf) for fit in fits] if both else fits

    monkeypatch.setattr(Shooting, "fit", fails)
    assert in_short_steps(numerics, numerics.given, part, part, found, tried, lambda _: None) is None
