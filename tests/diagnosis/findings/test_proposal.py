from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.experiment import Trial
from torch_activegp.diagnosis.findings.one_more import left_of_errors
from torch_activegp.diagnosis.findings.proposal import least_certain, propose
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.selection.judge import judge
from torch_activegp.diagnosis.shooting.score import Score

NUISANCES = [("viscous_friction", "joint:hip"), ("armature_error", "joint:hip"), ("payload_mass", "body:rod")]


@pytest.fixture(scope="module")
def wet(bench):
    return bench.fit("viscous_friction", 0.05)


def again(bench) -> Trial:
    """The first recording once more."""
    run = bench.machine.fit[0]
    return Trial(1.0, run, bench.engine.starts(cut([run], 1e9, 0.0))[0])


def left_of(bench, fit) -> float:
    """The part of the first standard error that is left with it."""
    return float(left_of_errors(bench.shooting, fit, *again(bench)[1:])[0])


def proposed(bench, *fits, doubts=(), **changed):
    selection = Selection(bench.nominal, [bench.nominal, *fits], Score(bench.shooting.samples, 20, 1.0))
    explanation = Explanation(bench.engine, bench.shooting, selection, bench.effects, given=bench.engine)
    judgement = dataclasses.replace(judge(bench.shooting, selection), **changed)
    return propose(explanation, judgement, bench.machine.fit, 0, doubts)


def test_where_all_rivals_are_ruled_out_the_least_certain_parameter_is_measured(bench, wet) -> None:
    entry, text = proposed(bench, wet, white=True)
    assert entry["separates"][0].startswith("coefficient of viscous_friction at joint:hip 0.0")
    assert entry["why"].startswith("nothing need be recorded: no rival is left")
    assert "standard error" in entry["why"]
    assert text.startswith("time,ctrl.drive")
    entry, _ = proposed(bench, wet, white=False)
    assert entry["why"].startswith("no rival is left")


def test_where_another_form_does_as_well_nothing_is_settled(bench, wet) -> None:
    other = dataclasses.replace(wet, effects=(dataclasses.replace(wet.effects[0], variant="another"),))
    entry, _ = proposed(bench, wet, other, white=True)
    assert entry["why"].startswith("no controls were found that would tell")


@pytest.mark.parametrize(
    ("error", "white", "first"),
    [
        (0.01, True, "nothing need be recorded: no rival"),
        (0.03, True, "no rival is left"),
        (0.01, False, "no rival is left"),
    ],
)
def test_what_is_known_well_need_not_be_recorded_again(bench, wet, error: float, white: bool, first: str) -> None:
    """Where only noise is left; else something is missing yet."""
    (coefficient,) = wet.values[0]
    found = least_certain(bench.shooting, wet, np.array([[(error * coefficient) ** 2]]), white=white)
    assert found is not None
    sentence, needed = found[1].said(again(bench))
    assert sentence.startswith(first)
    assert needed is not first.startswith("nothing")


@pytest.mark.parametrize(("left", "words"), [(0.91, "hardly more of viscous_friction"), (0.89, "standard error")])
def test_what_controls_would_hardly_tell_is_not_promised(bench, wet, monkeypatch, left: float, words: str) -> None:
    module = "torch_activegp.diagnosis.findings.proposal"
    monkeypatch.setattr(f"{module}.left_of_errors", lambda *_: np.array([left]))
    for error, well in ((0.01, True), (0.03, False)):
        found = least_certain(bench.shooting, wet, np.array([[(error * wet.values[0][0]) ** 2]]))
        assert found is not None
        sentence, needed = found[1].said(again(bench))
        assert words in sentence
        assert sentence.startswith("nothing need be recorded") is well
        assert needed is (left < 0.9 and not well)


def test_a_ratio_has_no_unit(bench) -> None:
    limit = bench.effect("actuator_saturation", "actuator:drive")
    information = np.array([[1e4]])
    fit = dataclasses.replace(bench.nominal, effects=(limit,), values=(np.array([0.1]),), information=information)
    found = least_certain(bench.shooting, fit, np.array([[1e-4]]))
    assert found is not None
    words, _ = found[1].said(again(bench))
    assert re.search(r"from 0\.01 to about 0\.\d+$", words)
    assert [text.rpartition(" ")[2] for text in found[1].separates] == ["0.08", "0.12"]


@pytest.mark.parametrize("listed", [True, False])
def test_where_no_controls_tell_a_tie_apart_none_is_said_to_be_settled(bench, wet, monkeypatch, listed: bool) -> None:
    """What can never be told apart does not compete, and is in the list of ties alone."""
    twin = dataclasses.replace(wet, effects=(bench.effect("quadratic_drag"),))
    monkeypatch.setattr(
        "torch_activegp.diagnosis.findings.proposal.next_experiment",
        lambda engine, fits, *rest: None if twin in fits else ({"why": rest[-1].said(again(bench))[0]}, ""),
    )
    ties = {"ties": ((bench.effect("quadratic_drag"),),), "verdict": "tie"}
    entry, _ = proposed(bench, wet, *([twin] if listed else []), **ties)
    assert entry["why"].startswith("no controls were found that would tell the rivals apart; the least certain number")


def test_rivals_that_are_open_are_told_apart(bench, wet) -> None:
    drag = dataclasses.replace(bench.fit("quadratic_drag", 0.02), chi2=wet.chi2 + 5.0)
    entry, _ = proposed(bench, wet, drag)
    assert entry["separates"] == ["viscous_friction", "quadratic_drag"]


def test_where_nothing_is_certain_rivals_are_told_apart_that_are_not_far_behind(bench, wet, monkeypatch) -> None:
    module = "torch_activegp.diagnosis.findings.proposal._FAR_BEHIND"
    monkeypatch.setattr(module, 1e9)
    entry, _ = proposed(bench, wet, verdict="unknown")
    assert entry["separates"] == ["viscous_friction", "no effect"]
    assert proposed(bench, verdict="unknown") is None
    assert proposed(bench, wet, verdict="unknown", doubts=["Column `ctrl.drive` is missing."]) is None
    monkeypatch.setattr(module, 10.0)
    assert proposed(bench, wet, verdict="unknown") is None


def test_nothing_is_proposed_where_nothing_differs(bench, wet) -> None:
    assert proposed(bench, wet, verdict="none") is None


def test_the_ends_of_the_least_certain_parameter_are_four_standard_errors_apart(bench, wet) -> None:
    (low, high), telling = least_certain(bench.shooting, wet, np.linalg.inv(wet.information))
    error = wet.information[0, 0] ** -0.5
    np.testing.assert_allclose(high.values[0] - low.values[0], 4.0 * error)
    assert (
        f"{error:.2g} N m s/rad to about {left_of(bench, wet) * error:.2g} N m s/rad" in telling.said(again(bench))[0]
    )
    np.testing.assert_allclose(
        np.subtract(*(least_certain(bench.shooting, wet, 4.0 / wet.information)[0][k].values[0] for k in (1, 0))),
        8.0 * error,
    )
    assert least_certain(bench.shooting, wet, np.zeros((1, 1))) is None


def test_a_number_that_has_no_name_is_told_by_its_effect(bench) -> None:
    cogging = bench.effect("cogging")
    fit = dataclasses.replace(
        bench.nominal, effects=(cogging,), values=(np.full(len(cogging.parameters), 0.5),), information=np.eye(3)
    )
    _, telling = least_certain(bench.shooting, fit, np.diag([1e-2, 1e-6, 1e-6]))
    percent = f"{100 * left_of(bench, fit):.2g}"
    told = f"cogging at joint:hip, whose standard errors these controls would bring to about {percent} %"
    assert told in telling.said(again(bench))[0]
    where = "cogging at joint:hip at"
    assert telling.separates == [f"{where} one end of its intervals", f"{where} the other end of its intervals"]


def test_what_is_fitted_along_and_not_named_is_neither_told_apart_nor_measured(bench) -> None:
    drag, rotor, load = (bench.effect(name, at) for name, at in NUISANCES)
    values = (np.array([0.06]), np.array([1e-3]))
    best, other = (bench.shooting.fit([((drag, e), values)], bench.nominal.starts)[0] for e in (rotor, load))
    apart, _ = proposed(bench, best, other, named=(drag, rotor), retuned=())
    assert sorted(apart["separates"]) == ["armature_error", "payload_mass"]
    measured, _ = proposed(bench, best, other, named=(drag,), retuned=(rotor,))
    assert measured["separates"][0].startswith("coefficient of viscous_friction")
    quite = bench.shooting.fit([((drag, bench.effect("quadratic_drag")), (values[0], np.array([0.01])))], best.starts)[
        0
    ]
    swaps = tuple((other, 0.1 * k, 0.2) for k in range(1, 4))
    changed = {"fit": best, "rivals": ((best, 0.0, 0.3), *swaps, (quite, 6.0, 0.1))}
    later, _ = proposed(bench, best, other, named=(drag,), retuned=(rotor,), **changed)
    assert sorted(later["separates"]) == ["armature_error", "quadratic_drag"]
    errors = np.diag([1e-6, 1.0])
    assert "armature" in least_certain(bench.shooting, best, errors)[1].separates[0]
    assert "coefficient" in least_certain(bench.shooting, best, errors, named=(drag,))[1].separates[0]


def test_other_parameters_follow_the_least_certain_one(bench, wet) -> None:
    information = np.array([[400.0, -19.0], [-19.0, 1.0]])
    effects = (wet.effects[0], bench.effect("constant_force"))
    fit = dataclasses.replace(wet, effects=effects, values=(np.ones(1), 9.0 * np.ones(1)), information=information)
    covariance = np.linalg.inv(information)
    (low, high), telling = least_certain(bench.shooting, fit, covariance)
    step = [high.values[k][0] - low.values[k][0] for k in range(2)]
    place = int(np.argmax(np.diag(covariance) ** 0.5 / [1.0, 9.0]))
    np.testing.assert_allclose(step, 4.0 * covariance[:, place] / covariance[place, place] ** 0.5)
    assert fit.effects[place].name in telling.separates[0]
