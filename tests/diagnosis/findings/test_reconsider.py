from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings import reconsider as module
from torch_activegp.diagnosis.findings.reconsider import reconsider
from torch_activegp.diagnosis.findings.verdict import Verdict, decide
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.diagnosis.simulation.engine import Engine

FAR, NEAR = 30.0, 1.1
STARTS = [[0.0, 0.0]]


def held_out(before: float, after: float) -> dict:
    """Errors of the held-out run in units of its noise."""
    errors = {"before": 0.01 * before, "after": 0.01 * after, "noise": 0.01}
    entry = {"run": "kept", "channel": "qpos.hip", "free_run": errors, "one_step": errors}
    return {"runs": [{**entry, "predictable": True}]}


@pytest.fixture
def explanation(bench) -> Explanation:
    fits = [bench.nominal, bench.fit("viscous_friction", 0.05)]
    selection = Selection(bench.nominal, fits, Score(bench.shooting.samples, 60, 1.0))
    return Explanation(bench.engine, bench.shooting, selection, bench.effects, given=bench.engine)


@pytest.fixture
def verdict(explanation) -> Verdict:
    return decide(explanation.shooting, explanation.selection, explanation.effects)


@pytest.mark.parametrize(("before", "after", "lost"), [(FAR, NEAR, False), (FAR, 20.0, True)])
def test_names_stand_unless_the_held_out_runs_speak_against_them(
    bench, explanation, verdict, before, after, lost
) -> None:
    named = verdict.judgement.fit
    assert verdict.judgement.verdict == "named"
    said = reconsider(bench.machine, explanation, verdict, named, held_out(before, after), STARTS)
    assert (said is not None) is lost
    if said is not None:
        assert said[0] is explanation
        assert (said[1].judgement.verdict, said[1].unforeseen) == ("unknown", "")
        assert "20 times the noise" in said[1].notes[-1]


def test_uncertain_parameters_excuse_free_runs_that_are_lost(bench, explanation, verdict, monkeypatch) -> None:
    asked: list[tuple] = []

    def expect(engine, shooting, fit, runs, starts) -> float:
        asked.append((engine.late, [run.label for run in runs], np.asarray(starts).tolist()))
        return 0.05

    monkeypatch.setattr(module, "expected_error", expect)
    leaping = dataclasses.replace(
        explanation, engine=Engine(bench.machine.model, bench.machine.channels, 2, 1, late=True)
    )
    kept = bench.machine.holdout[0]
    machine = dataclasses.replace(bench.machine, holdout=(dataclasses.replace(kept, label="wild"), kept))
    named = verdict.judgement.fit
    for left, lost in ((20.0, False), (29.0, True)):
        calm = held_out(FAR, left)["runs"][0]
        holdout = {"runs": [{**calm, "run": "wild", "predictable": False}, {**calm, "run": kept.label}]}
        said = reconsider(machine, leaping, verdict, named, holdout, [[1.0, 0.0], [2.0, 0.0]])
        assert (said is not None) is lost
    assert asked == [(False, [kept.label], [[2.0, 0.0]])]


def test_names_that_leave_much_are_taken_back_where_a_column_is_in_doubt(bench, explanation, verdict) -> None:
    machine = dataclasses.replace(bench.machine, doubts=("ctrl.drive may be in mN m.",))
    named = verdict.judgement.fit
    undriven = dataclasses.replace(bench.machine, undriven=("no control is recorded.",))
    loud = dataclasses.replace(named, chi2=200.0 * bench.shooting.dof)
    for some, why in ((machine, "a column is in doubt"), (undriven, "no control is recorded")):
        assert reconsider(some, explanation, verdict, named, held_out(FAR, NEAR), STARTS) is None
        said = reconsider(some, explanation, verdict, loud, held_out(FAR, NEAR), STARTS)
        assert said is not None
        assert why in said[1].notes[-1]


@pytest.mark.parametrize(
    ("before", "given", "other"),
    [(NEAR, "none", None), (FAR, "none", "unknown"), (FAR, "unknown", None)],
)
def test_without_a_name_held_out_runs_must_not_be_far_off(bench, explanation, verdict, before, given, other) -> None:
    nothing = dataclasses.replace(verdict.judgement, verdict=given, fit=bench.nominal)
    before_it = Verdict(nothing, None, ("a note",))
    said = reconsider(bench.machine, explanation, before_it, bench.nominal, held_out(before, before), STARTS)
    assert (None if said is None else said[1].judgement.verdict) == other
    if said is not None:
        assert "but not those held out: the free run of kept" in said[1].unforeseen
        assert said[1].notes == ("a note",)
        assert said[0].shooting.segments.runs == bench.machine.holdout


@pytest.mark.parametrize(("touches", "box", "other"), [(False, None, True), (True, None, False), (False, "box", False)])
def test_one_step_of_a_run_that_cannot_be_forecast_counts_unless_something_may_touch_in_it(
    bench, explanation, verdict, touches, box, other, monkeypatch
) -> None:
    asked = []

    def touching(model, channels, runs):
        asked.extend(runs)
        return np.zeros((2, 1)), np.array([False, touches])

    monkeypatch.setattr("torch_activegp.diagnosis.findings.reconsider.poses_that_touch", touching)
    run = dataclasses.replace(bench.machine.holdout[0], label="kept")
    machine = dataclasses.replace(bench.machine, holdout=(run, dataclasses.replace(run, label="calm")), box=box)
    nothing = Verdict(dataclasses.replace(verdict.judgement, verdict="none", fit=bench.nominal), None, ())
    wild = {"runs": [{**entry, "predictable": False} for entry in held_out(FAR, FAR)["runs"]]}
    said = reconsider(machine, explanation, nothing, bench.nominal, wild, STARTS)
    assert (said is not None) is other
    assert asked == ([run] if box is None else [])  # of the other nobody needs to know
