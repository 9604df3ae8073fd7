from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings import idle_names as module
from torch_activegp.diagnosis.findings.idle_names import without_idle
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.score import Score


@pytest.fixture
def loud(bench, monkeypatch):
    """A damping with a push that does nothing beside it; what they leave counts as much more than noise."""
    monkeypatch.setattr(module, "LOUD", 0.5)
    wet, push = bench.effect("viscous_friction"), bench.effect("constant_force")

    def explained(damping: float = bench.viscous, compared: bool = True) -> tuple[Explanation, object]:
        """With this much damping where it is alone, which was compared or not."""
        single = bench.fit("viscous_friction", bench.viscous)
        both = dataclasses.replace(single, effects=(wet, push), values=(*single.values, np.zeros(1)), columns=None)
        both = dataclasses.replace(both, chi2=0.7 * single.chi2)
        alone = [dataclasses.replace(single, values=(np.array([damping]),))] if compared else []
        selection = Selection(bench.nominal, [bench.nominal, *alone, both], Score(bench.shooting.samples, 60, 1.0))
        assert selection.best is both
        return Explanation(bench.engine, bench.shooting, selection, bench.effects, given=bench.engine), both

    return explained


@pytest.mark.parametrize("compared", [True, False])
def test_a_name_that_helps_no_forecast_is_taken_back_where_much_is_left(bench, loud, compared: bool) -> None:
    """Also where the set without it was not compared by then."""
    explanation, both = loud(compared=compared)
    found = without_idle(explanation, both, bench.machine.holdout)
    assert found is not None
    fewer, verdict = found
    assert [effect.key for effect in verdict.judgement.named] == [("viscous_friction", "joint:hip")]
    assert all(("constant_force", "joint:hip") not in fit.keys for fit in fewer.selection.fits)
    assert verdict.notes[-1].startswith("constant_force at joint:hip would fit these recordings better, but")
    assert without_idle(fewer, verdict.judgement.fit, bench.machine.holdout) is None  # the last name stays


def test_a_name_without_which_forecasts_are_worse_stays(bench, loud) -> None:
    explanation, both = loud(2.0 * bench.viscous)
    assert without_idle(explanation, both, bench.machine.holdout) is None


@pytest.mark.parametrize("kind", ["free_run", "one_step"])
def test_a_name_stays_that_helps_forecasts_of_one_kind(bench, loud, monkeypatch, kind: str) -> None:
    explanation, both = loud()
    compare = module.compare

    def worse(models, *given):
        errors, traces = compare(models, *given)
        return {
            **errors,
            kind: {name: e * (1.0 if name == "all" else 1.02) for name, e in errors[kind].items()},
        }, traces

    monkeypatch.setattr(module, "compare", worse)
    assert without_idle(explanation, both, bench.machine.holdout) is None


def test_where_noise_alone_is_left_nobody_asks(bench, loud, monkeypatch) -> None:
    explanation, both = loud()
    monkeypatch.setattr(module, "without_each", pytest.fail)
    monkeypatch.setattr(module, "LOUD", 5.0)
    assert without_idle(explanation, both, bench.machine.holdout) is None
