"""The remainder against a force that is known, and that it stays away where nothing is left."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from torch_activegp.diagnosis import Diagnosis, evaluate, load_corrected
from torch_activegp.diagnosis.findings.forecast import compare
from torch_activegp.diagnosis.findings.remainder import helps, misleads, model_remainder
from torch_activegp.diagnosis.inputs.segments import halve

NAMES = ("qpos.hip", "qvel.hip", "ctrl.drive")


@pytest.mark.parametrize("halved", [False, True])
def test_learns_the_force_that_a_model_leaves_out(bench: Any, halved: bool) -> None:
    """Also over segments of unlike length, which are simulated apart."""
    shooting, nominal = bench.shooting, bench.nominal
    if halved:
        segments = halve(bench.segments, np.arange(bench.segments.size) % 2 == 0)
        assert len(set(segments.lengths.tolist())) > 1
        shooting = dataclasses.replace(shooting, segments=segments)
        nominal = shooting.fit([((), ())], bench.engine.starts(segments))[0]
    outcome = model_remainder(shooting, nominal, NAMES)
    assert outcome.effect is not None
    runs = bench.machine.fit
    speed = np.concatenate([run.velocity[:-1, 0] for run in runs])
    inputs = np.stack(
        [np.concatenate([run.smooth[:-1, 0] for run in runs]), speed, np.concatenate([r.control[:, 0] for r in runs])],
        axis=1,
    )
    error = outcome.effect.force(inputs)[:, 0] + bench.viscous * speed
    assert np.sqrt(np.mean(error**2)) < 0.25 * bench.viscous * speed.std()


def test_says_what_it_used_and_on_what_it_was_judged(bench: Any) -> None:
    details = model_remainder(bench.shooting, bench.nominal, NAMES).details
    assert details["used"] is True
    assert set(details["length_scales"]["joint:hip"]) == set(NAMES)
    assert details["chi2_of_kept"]["gp"] < 0.5 * details["chi2_of_kept"]["after"]


@pytest.mark.parametrize(
    ("ahead", "freely", "does"),
    [
        (1.2, 1.2, True),
        (1.0, 1.0, False),
        (0.9, 1.1, False),
        (0.9, 5.0, True),
        (5.0, 0.9, True),
        (0.99, 1e9, True),
        (0.5, 1.5, False),
        (1.03, 1.03, True),
    ],
)
def test_a_force_misleads_that_forecasts_held_out_runs_worse_in_all(ahead, freely, does: bool) -> None:
    holdout = {"one_step": {"after": 0.1, "gp": 0.1 * ahead}, "free_run": {"after": 3.0, "gp": 3.0 * freely}}
    assert misleads(holdout) is does


def test_where_free_runs_fail_in_any_case_one_step_decides() -> None:
    free = {"after": 1e9, "gp": 1e9}
    assert misleads({"one_step": {"after": 0.1, "gp": 1.0}, "free_run": free})
    assert not misleads({"one_step": {"after": 0.1, "gp": 0.05}, "free_run": free})


def test_what_misleads_is_withheld_and_said_why(bench: Any) -> None:
    errors = {"before": 2.0, "after": 1.0, "gp": 3.0, "noise": 0.1}
    outcome = model_remainder(bench.shooting, bench.nominal, NAMES)
    outcome = outcome.withheld({"one_step": errors, "free_run": errors})
    assert outcome.effect is None
    assert outcome.details["used"] is False
    assert outcome.details["withheld"] == {kind: {"after": 1.0, "gp": 3.0} for kind in ("one_step", "free_run")}


def test_halves_the_free_run_error_on_a_run_it_has_not_seen(bench: Any) -> None:
    outcome = model_remainder(bench.shooting, bench.nominal, NAMES)
    nominal = bench.nominal.candidate
    models = {"before": (bench.engine, nominal), "gp": (bench.engine, outcome.on(nominal))}
    errors, _ = compare(models, bench.machine.holdout, bench.machine.channels.joints, bench.shooting.noise)
    assert errors["free_run"]["gp"] < 0.5 * errors["free_run"]["before"]
    assert errors["one_step"]["gp"] <= errors["one_step"]["before"]


def test_nothing_is_learned_behind_what_is_named(bench: Any) -> None:
    outcome = model_remainder(bench.shooting, bench.fit("viscous_friction", -bench.viscous), NAMES)
    assert outcome.effect is None
    assert outcome.details["chi2_of_kept"]["gp"] > outcome.details["chi2_of_kept"]["after"] - 10.0


def test_an_unknown_bump_is_forecast_and_saved(
    diagnosed: Callable[[str], Diagnosis], record: Any, tmp_path: Path
) -> None:
    diagnosis = diagnosed("bump")
    assert diagnosis.verdict == "unknown"
    assert diagnosis.details["remainder"]["used"]
    errors = diagnosis.details["fit"]["holdout"]["free_run"]
    assert errors["gp"] < 0.5 * errors["after"]
    assert all("gp" in run["free_run"] for run in diagnosis.details["fit"]["holdout"]["runs"])
    diagnosis.save(tmp_path)
    unseen = evaluate(diagnosis.learned, [record("bump", 9)], nthread=1)
    assert unseen["free_run"]["error"] == pytest.approx(errors["gp"], rel=0.05)
    again, at = load_corrected(tmp_path / "learned.pt"), (torch.full((1, 2), 0.4), torch.zeros(1, 1))
    assert torch.equal(again(*at), diagnosis.learned(*at))


def test_a_right_model_has_no_remainder(diagnosed: Callable[[str], Diagnosis]) -> None:
    diagnosis = diagnosed("none")
    assert diagnosis.details["remainder"] is None
    assert diagnosis.learned is None
    assert "learned.pt" not in diagnosis.files


@pytest.mark.parametrize(
    ("after", "learned", "used"),
    [
        (2000.0, 1940.0, True),
        (2000.0, 1960.0, False),  # less than a twentieth of what is beyond noise
        (1100.0, 1092.0, False),  # what chance takes
        (np.inf, 1500.0, True),
        (1500.0, np.inf, False),
        (np.inf, np.inf, False),
    ],
)
def test_it_must_take_a_part_of_what_is_beyond_noise(after: float, learned: float, used: bool) -> None:
    assert helps(after, learned, 1000) is used
