from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.polish import polish
from torch_activegp.diagnosis.selection.straightened import straightened
from torch_activegp.diagnosis.shooting.score import Score


@pytest.fixture
def wave(bench):
    return next(e for e in bench.effects if e.key == ("cogging", "joint:hip") and e.linear == 2)


def of(bench, wave, periods: float):
    push = bench.effect("viscous_friction")
    values = (np.array([0.05]), np.array([-0.3, 0.1, periods]))
    return dataclasses.replace(bench.nominal, effects=(push, wave), values=values)


def test_springs_stand_in_place_of_a_wave_at_its_bound_with_about_its_pull(bench, wave) -> None:
    fit = of(bench, wave, wave.parameters[2].low)
    sets = straightened(fit, bench.effects)
    springs = [effects[1] for effects, _ in sets]
    assert {spring.key for spring in springs} == {("linear_spring", "joint:hip"), ("cubic_spring", "joint:hip")}
    assert len(springs) == 3  # with a rest and without
    at = np.linspace(*wave.range, 41)
    pull, errors = wave.force(at, 0 * at, fit.values[1]), {}
    for effects, values in sets:
        assert (effects[0], values[0]) == (fit.effects[0], fit.values[0])
        errors[effects[1].variant, effects[1].name] = np.std(effects[1].force(at, 0 * at, values[1]) - pull)
    assert errors["rest", "linear_spring"] < 0.5 * pull.std()


def test_faster_waves_stay_and_sums_of_waves(bench, wave) -> None:
    assert straightened(of(bench, wave, 1.1 * wave.parameters[2].low), bench.effects) == []
    least = wave.more.parameters[4].low
    held = (np.array([0.1, 0.1, 0.1, 0.1, least, 2 * least]),)
    several = dataclasses.replace(bench.nominal, effects=(wave.more,), values=held)
    assert straightened(several, bench.effects) == []


def test_a_spring_that_is_there_is_not_there_twice(bench, wave) -> None:
    fit = of(bench, wave, wave.parameters[2].low)
    beside = bench.effect("linear_spring")
    more = dataclasses.replace(
        fit, effects=(*fit.effects, beside), values=(*fit.values, np.ones(len(beside.parameters)))
    )
    assert {effects[1].name for effects, _ in straightened(more, bench.effects)} == {"cubic_spring"}


def test_they_are_compared_in_the_end_though_the_search_was_cut_short(bench, wave, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.selection.polish.NOISE_ALONE", 0.0)  # much is left
    fit = of(bench, wave, wave.parameters[2].low)
    (held,) = bench.shooting.fit([(fit.effects, fit.values)], bench.nominal.starts, hold=True)
    held = dataclasses.replace(held, chi2=0.5 * bench.nominal.chi2)
    chosen = Selection(bench.nominal, [bench.nominal, held], Score(bench.shooting.samples, 60, 1.0), cut_short=True)
    polish(bench.shooting, chosen, bench.effects)
    assert any(("linear_spring", "joint:hip") in fit.keys for fit in chosen.fits)
