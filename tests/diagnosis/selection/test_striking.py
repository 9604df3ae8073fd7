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
    told = in_short_steps(numerics, numerics.given, part, found, tried, stages.append, True)
    assert told is not None
    effects, values = told
    assert [effect.name for effect in effects] == ["joint_stop"]
    assert values[0][[0, 2]] == pytest.approx([STIFFNESS, AT], rel=0.03)
    assert stages == ["testing what strikes in shorter time steps"]


@pytest.mark.parametrize("in_vain", [True, False])
def test_a_play_comes_on_top_of_names_that_lead_on(struck, numerics, part, found, tried, monkeypatch, in_vain) -> None:
    """And what strikes, stops too, in place of those that were found in vain, in the most precise steps."""
    push, play = (struck.effect(name) for name in ("constant_force", "backlash"))
    known = part.fit([((push,), (np.zeros(1),))], found.nominal.starts)[0]
    some = dataclasses.replace(found, fits=[found.nominal, known])
    asked: list = []

    def expand(tried: Selection, sharp: Shooting, effects: list[Effect], fit: Fit, work: float) -> None:
        asked.append((sharp.engine, effects, fit.effects))
        more = dataclasses.replace(fit, effects=(*fit.effects, play), values=(*fit.values, np.ones(1)), chi2=0.0)
        tried.add([more])

    monkeypatch.setattr(module, "expand", expand)
    told = in_short_steps(numerics, numerics.given, part, some, [*tried, play], lambda _: None, in_vain)
    assert told is not None
    ((engine, effects, begun),) = asked
    if in_vain:
        assert (engine, effects, begun) == (numerics.finest, [tried[1], play], ())
        assert tuple(told[0]) == (play,)
    else:
        assert (engine, effects, begun) == (numerics.quick, [play], (push,))
        assert tuple(told[0]) == (push, play)
    assert engine.substeps > part.engine.substeps


def test_what_was_found_stays_where_it_leaves_less(struck, numerics, part, found, tried) -> None:
    other = dataclasses.replace(found.nominal, effects=(struck.effect("viscous_friction"),), values=(np.ones(1),))
    better = dataclasses.replace(found, fits=[found.nominal, dataclasses.replace(other, chi2=float(part.dof))])
    assert in_short_steps(numerics, numerics.given, part, better, tried, lambda _: None, True) is None


def test_it_is_asked_only_of_what_strikes_and_where_steps_can_be_shorter(numerics, part, found, tried) -> None:
    smooth = [effect for effect in tried if not effect.strikes]
    asked: list[str] = []
    assert in_short_steps(numerics, numerics.given, part, found, smooth, asked.append, True) is None
    short = dataclasses.replace(part, engine=numerics.finest)
    assert in_short_steps(numerics, numerics.given, short, found, tried, asked.append, True) is None
    assert in_short_steps(numerics, numerics.given, part, found, tried, asked.append) is None  # a stop and no play
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
    told = in_short_steps(numerics, numerics.given, part, known, tried, lambda _: None, True)
    assert (told is not None) == taken


@pytest.mark.parametrize(("left", "taken"), [(0.39, False), (0.41, True)])
def test_a_play_makes_good_nothing_that_short_steps_lose(
    struck, numerics, part, found, monkeypatch, left, taken
) -> None:
    """It leaves less there than what was found does, but that leaves less than either in the steps it was found in."""
    push, play = (struck.effect(name) for name in ("constant_force", "backlash"))
    nominal = found.nominal

    def leaves(effects, part_of_it: float) -> Fit:
        values = tuple(effect.seeds[0] for effect in effects)
        return dataclasses.replace(nominal, effects=tuple(effects), values=values, chi2=part_of_it * nominal.chi2)

    known = dataclasses.replace(found, fits=[nominal, leaves([push], left)])
    monkeypatch.setattr(module, "expand", lambda tried, *_: tried.add([leaves([push, play], 0.4)]))
    monkeypatch.setattr(Shooting, "fit", lambda _, sets, *a, **k: [leaves(e, 1.0) for e, _ in sets])
    assert (in_short_steps(numerics, numerics.given, part, known, [push, play], lambda _: None) is not None) == taken
