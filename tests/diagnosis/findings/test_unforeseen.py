from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from torch_activegp.diagnosis import diagnose
from torch_activegp.diagnosis.findings.unforeseen import seen_there, surprise
from torch_activegp.diagnosis.findings.verdict import decide
from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.point import FAILED
from torch_activegp.diagnosis.shooting.score import Score


def said(free: float, step: float, predictable: bool = True) -> dict:
    """Held-out errors of two joints without any name, in parts of the motion, with noise of 0.02."""

    def entry(joint: str, free: float, step: float) -> dict:
        errors = {"free_run": {"before": free, "noise": 0.02}, "one_step": {"before": step, "noise": 0.02}}
        return {"run": "kept", "channel": f"qpos.{joint}", "predictable": predictable, **errors}

    return {"runs": [entry("knee", 0.02, 0.02), entry("hip", free, step)]}


@pytest.mark.parametrize(
    ("free", "step", "words"),
    [
        (0.06, 0.1, None),
        (0.08, 0.02, "the free run of kept is off by 0.08 of the motion of qpos.hip, 4 times the noise"),
        (0.02, 0.14, "a forecast by one step of kept is off by 0.14 of the motion of qpos.hip, 7 times"),
        (10.0, 0.14, "the free run"),
    ],
)
def test_held_out_runs_far_above_the_noise_are_a_surprise(bench, free, step, words) -> None:
    why = surprise(said(free, step)["runs"], bench.shooting)
    assert (why is None) is (words is None)
    assert why is None or words in why


@pytest.mark.parametrize(("step", "tells"), [(0.02, False), (0.14, True)])
def test_of_a_run_that_cannot_be_forecast_one_step_tells(bench, step, tells) -> None:
    why = surprise(said(10.0, step, predictable=False)["runs"], bench.shooting)
    assert (why is not None) is tells
    assert why is None or "a forecast by one step of kept is off by 0.14" in why


def test_a_joint_that_stands_still_has_no_motion_to_be_off_by(bench) -> None:
    errors = {"before": 9.0, "noise": 1.0}
    entry = {"run": "kept", "channel": "qpos.hip", "free_run": errors, "one_step": {"before": 1.0, "noise": 1.0}}
    why = surprise([entry], bench.shooting)
    assert why is not None
    assert "the free run of kept is off by 9 times the noise of qpos.hip, which stands still there." in why


def test_where_noise_may_be_louder_than_its_floor_more_is_no_surprise(bench) -> None:
    held_out = said(0.08, 0.02)["runs"]
    coloured = dataclasses.replace(bench.shooting, noise=NoiseModel(bench.shooting.noise.scale, np.array([[0.6, 0.0]])))
    assert surprise(held_out, bench.shooting) is not None
    assert surprise(held_out, coloured) is None


@pytest.fixture
def explanation(clean) -> Explanation:
    selection = Selection(clean.nominal, [clean.nominal], Score(clean.shooting.samples, 60, 1.0))
    return Explanation(clean.engine, clean.shooting, selection, clean.effects, given=clean.engine)


def loud(clean) -> tuple[Run, ...]:
    """The held-out run with a wave on top that no pendulum makes."""
    (run,) = clean.machine.holdout
    wave = 0.01 * np.sin(30.0 * run.time)[:, None]
    return (dataclasses.replace(run, position=run.position + wave),)


def test_held_out_runs_say_where_it_is(clean, explanation) -> None:
    verdict, runs = decide(explanation.shooting, explanation.selection, explanation.effects), loud(clean)
    there, judged = seen_there(explanation, verdict, runs, "why")
    assert (judged.unforeseen, judged.judgement.verdict, judged.judgement.white) == ("why", "unknown", False)
    assert there.shooting.segments.runs == runs
    assert there.selection.best is there.selection.nominal is judged.judgement.fit
    assert judged.judgement.p_value < 1e-5
    assert seen_there(explanation, verdict, clean.machine.holdout, "why") is None  # noise alone in brief pieces


def test_what_the_clock_of_held_out_runs_may_have_left_is_said_once_and_no_mismatch(
    clean, explanation, monkeypatch
) -> None:
    verdict = decide(explanation.shooting, explanation.selection, explanation.effects)
    monkeypatch.setattr("torch_activegp.diagnosis.findings.unforeseen.rounded_clock", lambda shooting, fit: "rounded")
    said = seen_there(explanation, verdict, loud(clean), "why")
    assert said == (explanation, verdict._replace(clock="rounded"))
    assert seen_there(*said, loud(clean), "why") is None


def test_a_mismatch_of_held_out_runs_keeps_what_was_said_of_the_clock(clean, explanation) -> None:
    verdict = decide(explanation.shooting, explanation.selection, explanation.effects)._replace(clock="rounded")
    _, judged = seen_there(explanation, verdict, loud(clean), "why")
    assert (judged.judgement.verdict, judged.clock, judged.unforeseen) == ("unknown", "rounded", "why")


@pytest.mark.parametrize("failed", [1, None])
def test_segments_that_no_simulation_follows_are_left_out(clean, explanation, monkeypatch, failed) -> None:
    verdict, runs, fit = (
        decide(explanation.shooting, explanation.selection, explanation.effects),
        loud(clean),
        Shooting.fit,
    )

    def fails(shooting: Shooting, *args, **kwargs) -> list[Fit]:
        found = fit(shooting, *args, **kwargs)[0]
        found.per_segment[:failed] = FAILED
        return [dataclasses.replace(found, chi2=np.inf)]

    monkeypatch.setattr(Shooting, "fit", fails)
    said = seen_there(explanation, verdict, runs, "why")
    assert (said is None) is (failed is None)
    if said is not None:
        whole = cut(runs, clean.segments.usual_seconds, 0.1).size
        assert said[0].shooting.segments.size == whole - 1
        assert np.isfinite(said[0].selection.nominal.chi2)


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
