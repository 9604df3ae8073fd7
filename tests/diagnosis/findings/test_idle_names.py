from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings import idle_names as module
from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.findings.idle_names import without_idle
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.score import Score


@pytest.fixture
def loud(bench, monkeypatch):
    """A damping, and a push that is there or not; what they leave counts as much more than noise."""
    monkeypatch.setattr(module, "LOUD", 0.5)
    wet, push = bench.effect("viscous_friction"), bench.effect("constant_force")

    def explained(force: float) -> tuple[Explanation, object, dict]:
        single = bench.fit("viscous_friction", bench.viscous)
        both = dataclasses.replace(single, effects=(wet, push), values=(*single.values, np.array([force])))
        both = dataclasses.replace(both, chi2=0.99 * single.chi2, columns=None)
        selection = Selection(bench.nominal, [bench.nominal, single, both], Score(bench.shooting.samples, 60, 1.0))
        explanation = Explanation(bench.engine, bench.shooting, selection, bench.effects, fine=False)
        runs, joints = bench.machine.holdout, bench.machine.channels.joints
        models = {"before": (bench.engine, bench.nominal.candidate), "after": (bench.engine, both.candidate)}
        return explanation, both, compare(models, runs, joints, bench.shooting.noise)[0]

    return explained


def test_a_name_that_helps_no_forecast_is_taken_back_where_much_is_left(bench, loud) -> None:
    explanation, both, holdout = loud(0.0)
    found = without_idle(explanation, both, holdout, bench.machine.holdout)
    assert found is not None
    fewer, verdict = found
    assert [effect.key for effect in verdict.judgement.named] == [("viscous_friction", "joint:hip")]
    assert all(("constant_force", "joint:hip") not in fit.keys for fit in fewer.selection.fits)
    assert verdict.notes[-1].startswith("constant_force at joint:hip would fit these recordings better, but")
    assert without_idle(fewer, verdict.judgement.fit, holdout, bench.machine.holdout) is None  # the last name stays


def test_a_name_that_helps_the_forecasts_stays(bench, loud) -> None:
    explanation, _, holdout = loud(0.0)
    better = {kind: {**holdout[kind], "after": 0.9 * holdout[kind]["after"]} for kind in ("free_run", "one_step")}
    both = explanation.selection.fits[-1]
    assert without_idle(explanation, both, better, bench.machine.holdout) is None
    one = {**better, "one_step": holdout["one_step"]}  # of one kind only
    assert without_idle(explanation, both, one, bench.machine.holdout) is None


def test_where_noise_alone_is_left_nobody_asks(bench, loud, monkeypatch) -> None:
    explanation, both, holdout = loud(0.0)
    monkeypatch.setattr(module, "compare", pytest.fail)
    monkeypatch.setattr(module, "LOUD", 5.0)
    assert without_idle(explanation, both, holdout, bench.machine.holdout) is None
    monkeypatch.setattr(module, "LOUD", 0.5)
    alone = dataclasses.replace(explanation.selection, fits=[explanation.selection.nominal, both])
    unknown = dataclasses.replace(explanation, selection=alone)
    assert without_idle(unknown, both, holdout, bench.machine.holdout) is None  # no smaller set was fitted
