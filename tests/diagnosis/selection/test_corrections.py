from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import corrections as module
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.corrections import correct_alike
from torch_activegp.diagnosis.shooting.score import Score

TUNED = {"viscous_friction", "armature_error", "actuator_gain"}


@pytest.fixture
def selection(bench) -> Selection:
    """Three names of which two have a correction each, behind a nominal that seems to be tuned."""
    free = frozenset(effect.key for effect in bench.effects if effect.tunable)
    rotor, gain = bench.effect("armature_error"), bench.effect("actuator_gain", "actuator:drive")
    sets = [
        (bench.effect("quadratic_drag"), rotor),
        (bench.effect("coulomb_friction"), gain),
        (bench.effect("cubic_spring"),),
    ]
    fits = bench.shooting.fit([(some, [np.array([0.01])] * len(some)) for some in sets], bench.nominal.starts)
    near = [dataclasses.replace(fit, chi2=fits[0].chi2 + 5.0 * i) for i, fit in enumerate(fits)]
    return Selection(bench.nominal, [bench.nominal, *near], Score(bench.shooting.samples, 60, 1.0, free=free))


def test_every_rival_has_the_same_corrections(bench, selection, monkeypatch) -> None:
    asked = []

    def listen(nominal, alone, without, best, needed) -> bool:
        asked.append((nominal, alone, without, best))
        return not needed

    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", listen)
    free = selection.score.free
    correct_alike(selection, bench.shooting, bench.effects)
    whole = [fit for fit in selection.fits if {key for key in fit.keys if key not in free} and len(fit.effects) > 1]
    named = [{effect.name for effect in fit.effects if effect.key not in free} for fit in whole]
    assert {"quadratic_drag"} in named and {"coulomb_friction"} in named and {"cubic_spring"} in named
    corrections = {frozenset(effect.key for effect in fit.effects if effect.key in free) for fit in whole}
    assert len(corrections) == 1
    names = {name for name, _ in corrections.pop()}
    assert names >= TUNED
    assert len(names & {"constant_force", "actuator_bias"}) == 1  # they say the same
    assert selection.score.corrected
    assert selection.best in whole
    nominal, alone, without, best = asked[0]
    assert (nominal, best) == (bench.nominal, selection.best)
    assert set(alone.keys) | set(without.keys) == set(best.keys)
    assert not set(alone.keys) & set(without.keys)


def test_corrections_that_are_more_than_a_tuning_change_nothing(bench, selection) -> None:
    """A damping is what is missing here: beside the others it explains all."""
    fits, score = list(selection.fits), selection.score
    correct_alike(selection, bench.shooting, bench.effects)
    assert (selection.fits, selection.score) == (fits, score)


@pytest.mark.parametrize("change", ["no tuning", "cut short"])
def test_nothing_is_done_without_a_tuning_or_behind_a_search_without_end(bench, selection, change: str) -> None:
    if change == "no tuning":
        selection.score = dataclasses.replace(selection.score, free=frozenset())
    else:
        selection.cut_short = True
    work = bench.shooting.work
    correct_alike(selection, bench.shooting, bench.effects)
    assert bench.shooting.work == work


def test_names_far_behind_and_further_forms_of_one_are_no_rivals(bench, selection) -> None:
    best = selection.best
    far = dataclasses.replace(best, effects=(bench.effect("linear_spring"),), values=(np.ones(1),), chi2=best.chi2 + 99)
    also = dataclasses.replace(best, effects=best.effects[:1], values=best.values[:1], chi2=best.chi2 + 20)
    selection.add([far, also])
    found = module._rivals(selection)
    assert sorted(fit.effects[0].name for fit in found) == ["coulomb_friction", "cubic_spring", "quadratic_drag"]
    assert also not in found


@pytest.mark.parametrize(("lost", "changed"), [(100.0, False), (12.0, True), (0.0, True)])
def test_corrections_that_explain_less_change_nothing(
    bench, selection, monkeypatch, lost: float, changed: bool
) -> None:
    """A rotor does the same as a gain to first order, and cannot be lighter than nothing."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.tuning.only_undoes", lambda *_: True)
    selection.fits = [bench.nominal, selection.best]
    selection.score = dataclasses.replace(selection.score, scale=3.0)
    assert selection.score.a_parameter < 12.0 < 3.0 * selection.score.a_parameter < 100.0
    fits, score, best = list(selection.fits), selection.score, selection.best
    some = (*best.effects, bench.effect("actuator_bias", "actuator:drive"))
    values = (*best.values, np.zeros(1))
    worse = dataclasses.replace(best, effects=some, values=values, chi2=best.chi2 + lost)
    monkeypatch.setattr(module, "compare", lambda shooting, other, sets, near: other.add([worse]))
    monkeypatch.setattr(module, "_beside", lambda *_: (some, values))
    correct_alike(selection, bench.shooting, bench.effects)
    assert ((selection.fits, selection.score) != (fits, score)) is changed


def test_what_rivals_have_is_kept_of_corrections_that_do_the_same(bench, selection, monkeypatch) -> None:
    """A drive's bias and a constant force on its joint: whichever the best set has."""
    sets = []
    monkeypatch.setattr(module, "compare", lambda shooting, other, some, near: sets.extend(some))
    monkeypatch.setattr(module, "_only_corrects", lambda *_: False)
    for name, target in (("constant_force", "joint:hip"), ("actuator_bias", "actuator:drive")):
        push = bench.effect(name, target)
        some, values = (*selection.best.effects, push), (*selection.best.values, np.zeros(1))
        better = dataclasses.replace(selection.best, effects=some, values=values, chi2=selection.best.chi2 - 100.0)
        sets.clear()
        other = dataclasses.replace(selection, fits=[*selection.fits, better])
        correct_alike(other, bench.shooting, bench.effects)
        assert sets
        for effects, _ in sets:
            assert [e.name for e in effects if e.name in ("constant_force", "actuator_bias")] == [name]
