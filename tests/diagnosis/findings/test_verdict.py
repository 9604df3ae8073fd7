from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.verdict import decide, without_name
from torch_activegp.diagnosis.result import EffectStability, Stability
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.shooting.score import Score


@pytest.fixture
def selection(bench) -> Selection:
    fits = [bench.nominal, bench.fit("viscous_friction", 0.05), bench.fit("coulomb_friction", 0.01)]
    return Selection(bench.nominal, fits, Score(bench.shooting.samples, 60, 1.0))


def test_a_name_that_forecasts_what_was_left_out_stays(bench, selection) -> None:
    judgement, stable, notes, *_ = decide(bench.shooting, selection, bench.effects)
    assert [effect.name for effect in judgement.named] == ["viscous_friction"]
    assert stable is not None
    assert not stable.effects[0].refuted
    assert notes == ()


def test_a_refuted_name_makes_way_for_the_next_best_set(bench, selection, monkeypatch) -> None:
    """The recordings left out are said to be worse for friction by the speed; dry friction comes next, and is not."""

    def said(shooting, selection, judgement) -> Stability:
        effects = [
            EffectStability(e.name, e.target, (4.0, -20.0), (), {}, refuted=e.name == "viscous_friction")
            for e in judgement.named
        ]
        return Stability(("a", "b"), tuple(effects), "said", True)

    monkeypatch.setattr("torch_activegp.diagnosis.findings.verdict.stability", said)
    plain, (nominal, _, dry) = selection.score, selection.fits
    selection.score = dataclasses.replace(plain, free=frozenset({("coulomb_friction", "joint:hip")}))
    judgement, _, notes, *_ = decide(bench.shooting, selection, bench.effects)
    assert judgement.fit.keys == {("coulomb_friction", "joint:hip")}
    assert [words.split(" would")[0] for words in notes] == ["viscous_friction at joint:hip"]
    assert "of 1 of the 2 recordings left out worse" in notes[0]
    assert len(selection.fits) == 3  # the caller's own are left alone
    left = Selection(nominal, [nominal, dry], plain)
    left.rescale(bench.shooting.dof)
    assert judgement.rivals[1][1] == pytest.approx(left.score(nominal) - left.score(dry))  # dry friction costs its name


@pytest.mark.parametrize("said", ["Times were rounded.", ""])
def test_what_the_clock_may_have_left_is_no_mismatch(bench, selection, monkeypatch, said: str) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.findings.verdict.rounded_clock", lambda shooting, fit: said)
    selection.fits = [bench.nominal]
    found = decide(bench.shooting, selection, bench.effects)
    assert (found.judgement.verdict, found.clock) == ("none" if said else "unknown", said)
    assert found.judgement.unexplained == (0.0 if said else 1.0)
    assert not found.judgement.white


def test_a_name_needs_no_clock(bench, selection, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.findings.verdict.rounded_clock", lambda shooting, fit: "rounded")
    found = decide(bench.shooting, selection, bench.effects)
    assert (found.judgement.verdict, found.clock) == ("named", "")


def test_without_a_name_a_friction_that_is_alike_both_ways_is_one_law(bench, selection) -> None:
    law = next(e for e in bench.effects if e.key == ("asymmetric_friction", "joint:hip") and e.variant == "coulomb")
    dry = selection.fits[2]
    both = dataclasses.replace(dry, effects=(law,), values=(np.full(2, 0.01),), chi2=dry.chi2 - 50.0)
    selection.fits = [*selection.fits[:2], both]
    found = without_name(bench.shooting, selection, ("viscous_friction", "joint:hip"), bench.effects)
    assert found.best.keys == {("coulomb_friction", "joint:hip")}
