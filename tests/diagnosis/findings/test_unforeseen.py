from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from torch_activegp.diagnosis import diagnose
from torch_activegp.diagnosis.findings.unforeseen import seen_there, surprise
from torch_activegp.diagnosis.findings.verdict import decide
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.score import Score


def said(free: float, step: float, run: str) -> dict:
    """Held-out errors of two runs without any name; noise is 2."""

    def entry(label: str, free: float, step: float) -> dict:
        errors = {"free_run": {"before": free, "noise": 2.0}, "one_step": {"before": step, "noise": 2.0}}
        return {"run": label, "channel": "qpos.hip", **errors}

    return {"runs": [entry(run, 2.0, 2.0), entry(run, free, step)]}


@pytest.mark.parametrize(
    ("free", "step", "words"),
    [
        (6.0, 10.0, None),
        (8.0, 2.0, "the free run of kept is off by 8 of the motion of qpos.hip, 4 times the noise"),
        (2.0, 14.0, "a forecast by one step of kept is off by 14 of the motion of qpos.hip, 7 times"),
        (1e3, 14.0, "the free run"),
    ],
)
def test_held_out_runs_far_above_the_noise_are_a_surprise(bench, free, step, words) -> None:
    runs, start = bench.machine.holdout, bench.engine.starts(bench.segments)[:1]
    assert runs[0].label == "kept"
    why = surprise(said(free, step, "kept"), bench.shooting, bench.engine, runs, start.tolist())
    assert (why is None) is (words is None)
    assert why is None or words in why
    assert surprise(said(free, step, "another"), bench.shooting, bench.engine, runs, start.tolist()) is None


def test_where_noise_may_be_louder_than_its_floor_more_is_no_surprise(bench) -> None:
    runs, start = bench.machine.holdout, bench.engine.starts(bench.segments)[:1]
    held_out = said(8.0, 2.0, "kept")
    coloured = dataclasses.replace(bench.shooting, noise=NoiseModel(bench.shooting.noise.scale, np.array([[0.6, 0.0]])))
    assert surprise(held_out, bench.shooting, bench.engine, runs, start.tolist()) is not None
    assert surprise(held_out, coloured, bench.engine, runs, start.tolist()) is None


def test_nothing_is_seen_where_no_simulation_follows(bench, monkeypatch) -> None:
    selection = Selection(bench.nominal, [bench.nominal], Score(bench.shooting.samples, 60, 1.0))
    explanation = Explanation(bench.engine, bench.shooting, selection, bench.effects, fine=False)
    verdict = decide(bench.shooting, selection)
    there, judged = seen_there(explanation, verdict, bench.machine.holdout, "why")
    assert (judged.unforeseen, judged.judgement.verdict) == ("why", "unknown")
    assert {run.label for run in there.shooting.segments.runs} == {"kept"}
    assert there.selection.best is there.selection.nominal is judged.judgement.fit
    failed = dataclasses.replace(bench.nominal, chi2=np.inf)
    monkeypatch.setattr("torch_activegp.diagnosis.shooting.likelihood.Shooting.fit", lambda *_, **__: [failed])
    assert seen_there(explanation, verdict, bench.machine.holdout, "why") is None


def test_a_mismatch_that_only_the_held_out_run_meets_is_none_of_noise(bench, record) -> None:
    """A bump around 0.4 rad, 0.08 rad wide, which the recordings that are fitted were made without."""
    runs = [record("none", seed) for seed in range(3)]
    found, good = (diagnose(bench.xml, runs, [record(kind, 9, "kept")], nthread=1) for kind in ("bump", "none"))
    assert (good.verdict, found.verdict) == ("none", "unknown")
    assert good.sentence == "The simulator and the recordings differ by noise alone."
    assert "differ by noise alone, but not those held out: the free run of kept is off by" in found.sentence
    assert found.effects == ()
    assert found.learned is None  # the held-out runs teach nothing
    details = json.loads(json.dumps(found.details))
    assert details["mismatch"]["detected"]
    assert details["mismatch"]["p_value"] < 1e-5
    assert details["mismatch"]["chi2_per_dof"] > 2.0
    first = details["location"][0]
    assert first["target"] == "joint:hip"
    low, high = first["region"]["qpos.hip"]
    assert 0.24 < low < high < 0.56
    assert [entry["run"] for entry in found.evidence["map_time"]] == ["kept"]
