"""Forms of one effect that fit as well."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.entries import named_effects
from torch_activegp.diagnosis.findings.open_forms import open_forms, widened
from torch_activegp.diagnosis.findings.short_steps import Numbers
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.intervals import estimates
from torch_activegp.diagnosis.shooting.score import Score

FOURTH = 0.25


@pytest.fixture
def loads(bench):
    """A load that was chosen, with a fourth of it as another form."""
    effect = next(effect for effect in bench.effects if effect.name == "payload_mass")
    fit = bench.shooting.fit([((effect,), (np.array([0.05]),))], bench.nominal.starts)[0]
    fit = dataclasses.replace(
        fit, information=1e4 * fit.information, scores=1e2 * fit.scores
    )  # a hundred times as sure
    other = dataclasses.replace(effect, variant="another", offset=(0.0, 0.1, 0.0))
    rival = dataclasses.replace(fit, effects=(other,), values=(FOURTH * fit.values[0],), chi2=fit.chi2 + 1.0)
    return fit, effect, rival, other


def compared(bench, *fits, scale: float = 1.0) -> Selection:
    score = dataclasses.replace(Score(bench.shooting.samples, 10, 1.0), scale=scale)
    return Selection(bench.nominal, list(fits), score)


def test_a_form_that_fits_as_well_is_open(bench, loads) -> None:
    fit, effect, rival, other = loads
    stuck = dataclasses.replace(rival, chi2=rival.chi2 + 1.0)
    resting = dataclasses.replace(rival, chi2=fit.chi2, at_rest=True)
    assert open_forms(compared(bench, fit, stuck, rival, resting), fit, effect) == [(other, rival)]


@pytest.mark.parametrize(("worse", "scale", "count"), [(3.8, 1.0, 1), (3.9, 1.0, 0), (3.9, 1.1, 1)])
def test_a_form_that_fits_worse_by_more_than_95_percent_allow_is_not(bench, loads, worse, scale, count) -> None:
    fit, effect, rival, _ = loads
    rival = dataclasses.replace(rival, chi2=fit.chi2 + worse)
    assert len(open_forms(compared(bench, fit, rival, scale=scale), fit, effect)) == count


def test_other_names_other_sets_and_freer_forms_are_no_form_of_it(bench, loads) -> None:
    fit, effect, rival, other = loads
    friction = bench.fit("viscous_friction", 0.05)
    freer = dataclasses.replace(other, parameters=2 * other.parameters)
    sets = [
        dataclasses.replace(friction, chi2=fit.chi2),
        dataclasses.replace(rival, effects=(*rival.effects, *friction.effects)),
        dataclasses.replace(rival, effects=(freer,)),
    ]
    assert open_forms(compared(bench, fit, *sets), fit, effect) == []


def test_a_form_that_no_machine_can_have_is_none(bench, loads, monkeypatch) -> None:
    fit, effect, rival, other = loads
    monkeypatch.setattr(type(other), "plausible", lambda *_: False)
    assert open_forms(compared(bench, fit, rival), fit, effect) == []


def test_an_interval_spans_those_of_all_forms_and_keeps_its_value(bench, loads) -> None:
    fit, effect, rival, other = loads
    own, its = estimates(bench.shooting, fit, effect)["mass"], estimates(bench.shooting, rival, other)["mass"]
    out, wider = widened(bench.shooting, {"mass": own}, [(other, rival)])
    assert out["mass"].value == own.value
    ends = [*own.ci95, *its.ci95]
    assert out["mass"].ci95 == (min(ends), max(ends))
    assert wider == [other]


def test_a_form_with_the_same_numbers_or_another_unit_widens_nothing_by_much(bench, loads) -> None:
    fit, effect, rival, other = loads
    own = estimates(bench.shooting, fit, effect)
    same = dataclasses.replace(rival, values=fit.values)
    assert widened(bench.shooting, own, [(other, same)]) == (own, [])
    grams = {"mass": dataclasses.replace(own["mass"], unit="g")}
    assert widened(bench.shooting, grams, [(other, rival)]) == (grams, [])


def test_the_note_gives_the_laws_between_which_nothing_decides(bench, loads) -> None:
    fit, effect, rival, other = loads
    explanation = SimpleNamespace(shooting=bench.shooting, selection=compared(bench, fit, rival))
    judged = {"verdict": "named", "fit": fit, "named": (effect,), "shares": (1.0,), "probabilities": (1.0,)}
    judgement = SimpleNamespace(**judged, ties=((),))
    (named,), notes = named_effects(explanation, judgement, {effect: True}, Numbers(fit, bench.shooting))
    assert named.parameters["mass"].ci95[0] <= FOURTH * named.parameters["mass"].value
    assert notes == [
        f"payload_mass at {effect.target}: the recordings fit as well with {other.law_with(np.zeros(1))}. Its interval "
        "spans all these; its value is for the law that is given."
    ]
    alone = SimpleNamespace(shooting=bench.shooting, selection=compared(bench, fit))
    (kept,), none = named_effects(alone, judgement, {effect: True}, Numbers(fit, bench.shooting))
    assert none == []
    sharp = dataclasses.replace(fit)  # the numbers of shorter steps are compared with none of longer ones
    (kept,), none = named_effects(explanation, judgement, {effect: True}, Numbers(sharp, bench.shooting))
    assert none == []
    assert kept.parameters == estimates(bench.shooting, fit, effect)
