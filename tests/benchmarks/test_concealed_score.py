"""The scorer gives what is due."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")

from benchmarks.concealed import bars
from benchmarks.concealed.diagram import draw_reliability
from benchmarks.concealed.equivalence import equals, overlap
from benchmarks.concealed.markdown import report
from benchmarks.concealed.oracle import checked
from benchmarks.concealed.regions import area
from benchmarks.concealed.run import digest
from benchmarks.concealed.score import score_all, score_case

KEY: dict[str, Any] = {
    "case": "case_000", "kind": "single", "system": "pendulum", "loop": "open loop", "rate": 100, "chi2_per_dof": 3.0,
    "noise": {"qpos.hinge": 1e-3}, "concealments": [], "retuned": False,
    "machine": {"joints": ["hinge"], "bodies": ["rod"], "motors": {"drive": "hinge"}},
    "effects": [{"name": "actuator_delay", "target": "actuator:drive", "region": None,
                 "parameters": {"seconds": {"value": 0.01, "unit": "s"}}}],
}  # fmt: skip


def answer(*entries: tuple[str, str], verdict: str = "named", ties: list[dict[str, str]] | None = None) -> dict:
    effects = [
        {"name": name, "target": target, "probability": 0.97, "ties": ties or [],
         "parameters": {"seconds": {"value": 0.011, "unit": "s", "ci95": [0.009, 0.013]}}}
        for name, target in entries
    ]  # fmt: skip
    return {"verdict": verdict, "mismatch": {"detected": verdict != "none"}, "effects": effects,
            "location": [{"target": "joint:hinge", "region": None}]}  # fmt: skip


def test_the_right_name_its_equal_and_a_tie_are_told_from_a_wrong_one() -> None:
    right = score_case(KEY, answer(("actuator_delay", "actuator:drive")))
    assert right["exact"] and right["tied"] and not right["any_wrong"]
    assert right["parameters"] == [
        {"effect": "actuator_delay", "parameter": "seconds", "error": pytest.approx(0.1), "covered": True}
    ]
    assert score_case(KEY, answer(("sensor_delay", "sensor:hinge_encoder")))["exact"]
    ties = [{"name": "actuator_delay", "target": "actuator:drive"}]
    tie = score_case(KEY, answer(("actuator_lag", "actuator:drive"), verdict="tie", ties=ties))
    assert (tie["exact"], tie["tie_claimed"], tie["any_wrong"], tie["ties"]) == (False, True, False, [2])
    assert tie["probability"] == [(0.97, False)]
    wrong = score_case(KEY, answer(("actuator_delay", "actuator:drive"), ("coulomb_friction", "joint:hinge")))
    assert not wrong["exact"] and wrong["any_wrong"]
    assert score_case(KEY, answer(verdict="unknown"))["abstained"]


def test_controls_outside_effects_and_parts_of_an_effect() -> None:
    control = {**KEY, "kind": "controls", "effects": []}
    assert not score_case(control, answer(verdict="none"))["false_alarm"]
    assert score_case(control, answer(verdict="unknown"))["false_alarm"]
    outside = {**KEY, "kind": "outside", "effects": [{**KEY["effects"][0], "name": "hum", "target": "joint:hinge"}]}
    assert score_case(outside, answer(("actuator_bias", "actuator:drive")))["any_wrong"]
    dry = {"name": "asymmetric_friction", "target": "joint:hinge", "region": None,
           "parameters": {"positive_level": {"value": 1.0}, "negative_level": {"value": 0.4}}}  # fmt: skip
    split = answer(("coulomb_friction", "joint:hinge"), ("actuator_bias", "actuator:drive"))
    assert score_case({**KEY, "effects": [dry]}, split)["exact"]


def test_a_run_that_fails_is_counted(tmp_path: Path) -> None:
    for name in ("case_000", "case_001"):
        (tmp_path / "keys").mkdir(exist_ok=True)
        (tmp_path / "keys" / f"{name}.json").write_text(json.dumps({**KEY, "case": name}), encoding="utf-8")
    failed = tmp_path / "results" / "diagnosis" / "case_000" / "failed.txt"
    failed.parent.mkdir(parents=True)
    failed.write_text("no", encoding="utf-8")
    (row,), missing = score_all(tmp_path)
    assert (row["verdict"], row["exact"], row["late"], missing) == ("failed", False, False, ["case_001"])
    failed.write_text("out of time: more than 600 s", encoding="utf-8")
    (row,), _ = score_all(tmp_path)
    assert row["late"] and not row["abstained"]


def test_equal_names_overlap_and_others_do_not() -> None:
    force, bias = ("constant_force", "joint:hinge"), ("actuator_bias", "actuator:drive")
    assert equals(force, KEY) == {force, bias}
    assert overlap([force, bias], KEY)
    assert not overlap([force, ("coulomb_friction", "joint:hinge")], KEY)


def test_a_tie_counts_only_where_the_truth_fits_no_better() -> None:
    ties = [{"name": "actuator_delay", "target": "actuator:drive"}]
    tie = answer(("actuator_lag", "actuator:drive"), verdict="tie", ties=ties)
    for said, parameters, genuine in ((108.0, 1, True), (112.0, 1, False), (111.0, 3, True)):
        oracle = {"chi2": 100.0, "parameters": parameters, "tie": {"chi2": said, "parameters": 1}}
        row = score_case(KEY, tie, oracle=oracle)
        assert (row["exact"], row["tied"], row["tie_claimed"]) == (False, genuine, True)
    assert not score_case(KEY, tie)["tied"]  # nobody has checked


def test_a_tie_of_another_diagnosis_is_unchecked(tmp_path: Path) -> None:
    tie = answer(("actuator_lag", "actuator:drive"), verdict="tie",
                 ties=[{"name": "actuator_delay", "target": "actuator:drive"}])  # fmt: skip
    case = tmp_path / "cases" / "case_000"
    said, seen = (tmp_path / "results" / way / case.name / f"{way}.json" for way in ("diagnosis", "oracle"))
    for path in (tmp_path / "keys" / "case_000.json", said, seen):
        path.parent.mkdir(parents=True)
    (tmp_path / "keys" / "case_000.json").write_text(json.dumps(KEY))
    said.write_text(json.dumps(tie))
    facts = {"chi2": 100.0, "parameters": 1, "tie": {"chi2": 100.0, "parameters": 1}}
    for word, fits in ((digest(said), True), ("another", False), (None, False)):
        seen.write_text(json.dumps({**facts, "diagnosis": word}))
        (row,), _ = score_all(tmp_path)
        assert (row["tie_claimed"], row["tied"], row["tie_unchecked"]) == (True, fits, not fits)
        assert checked(case, seen) is fits


def test_parameters_are_compared_in_the_same_terms() -> None:
    def parts(
        name: str, target: str, true: dict[str, float], said: dict[str, float], unit: str = "", **more: Any
    ) -> dict[str, Any]:
        effect = {"name": name, "target": target, "region": None,
                  "parameters": {parameter: {"value": value} for parameter, value in true.items()}}  # fmt: skip
        entry = {"name": name, "target": target,
                 "parameters": {parameter: {"value": value, "unit": unit, "ci95": [value - 0.1, value + 0.1]}
                                for parameter, value in said.items()}}  # fmt: skip
        diagnosis = {**answer(), "effects": [entry]}
        return {
            row["parameter"]: row for row in score_case({**KEY, "effects": [effect], **more}, diagnosis)["parameters"]
        }

    joint = "joint:hinge"
    cogging = parts("cogging", joint, {"amplitude": 1.0, "phase": 6.2}, {"amplitude": 1.05, "phase": -0.05})
    assert cogging["phase"] == {"effect": "cogging", "parameter": "phase", "error": None, "covered": True}
    assert cogging["amplitude"]["error"] == pytest.approx(0.05)
    slider = parts("hysteresis", joint, {"stiffness": 4.0, "slip": 2.0}, {"stiffness": 4.0, "slip": 0.75})
    assert slider["slip"]["error"] == pytest.approx(0.5) and not slider["slip"]["covered"]
    gain = parts("actuator_gain", "actuator:drive", {"gain": 1.2}, {"gain": 1.25})
    assert gain["gain"]["error"] == pytest.approx(0.25)
    limit = "actuator_saturation", "actuator:drive", {"limit": 2.0}, {"limit": 1.0}
    assert parts(*limit, "1", loop="servo") == {}  # of the command
    assert parts(*limit, "N m", loop="servo")["limit"]["error"] == pytest.approx(0.5)
    assert parts(*limit, "1")["limit"]["error"] == pytest.approx(0.5)


def test_places_of_actuators_bodies_and_sensors() -> None:
    row = score_case(KEY, answer(("sensor_delay", "sensor:hinge_encoder")))
    assert row["places"] == [{"kind": "actuator", "located": True, "named": True}]
    missed = {**answer(verdict="none"), "location": []}
    assert score_case(KEY, missed)["places"] == [{"kind": "actuator", "located": False, "named": False}]
    gravity = {**KEY, "effects": [{"name": "gravity_error", "target": "world", "region": None, "parameters": {}}]}
    assert score_case(gravity, answer())["places"] == []


def test_where_the_nominal_errs_by_noise_nothing_is_said_of_what_was_learned() -> None:
    quiet, below = ({"before": b, "after": b, "gp": g, "noise": 0.05} for b, g in ((0.052, 0.01), (0.4, 0.04)))
    row = score_case(KEY, {**answer(), "fit": {"holdout": {"one_step": quiet, "free_run": below}}})
    assert np.isnan(row["one_step_learned_beyond_noise"])
    assert row["free_run_learned_beyond_noise"] == 0.0


def test_forecasts_are_set_against_the_oracle_and_the_nominal() -> None:
    errors = {"before": 0.4, "after": 0.3, "gp": 0.1, "noise": 0.05}
    said = {**answer(), "fit": {"holdout": {"one_step": errors, "free_run": errors}}}
    row = score_case(KEY, said, oracle={"holdout": {"one_step": {"oracle": 0.2}, "free_run": {"oracle": 0.25}}})
    assert row["free_run"] == pytest.approx(6)
    assert row["free_run_oracle"] == pytest.approx(1.2)
    assert row["one_step_learned"] == pytest.approx(0.25)
    assert row["one_step_learned_beyond_noise"] == pytest.approx(((0.1**2 - 0.05**2) / (0.4**2 - 0.05**2)) ** 0.5)
    outside = {
        **row,
        "kind": "outside",
        "verdict": "unknown",
        "late": False,
        "seconds": 1.0,
        "cpu_seconds": 1.0,
        "peak_mib": 300.0,
    }
    lines = dict(bars.bars([outside]))
    assert lines["outside of the list: held-out one step halved by what is learned"].startswith("100.0 %")
    assert lines["outside of the list: the same, beyond noise"] == "0.218 (median of 1)"


def test_noise_is_told_in_mrad() -> None:
    assert score_case(KEY, answer())["noise"] == pytest.approx(1.0)
    slide = {**KEY, "system": "slide", "noise": {"qpos.hinge": 6e-4}}
    assert score_case(slide, answer())["noise"] == pytest.approx(2.0)


def test_the_figures_of_the_report(tmp_path: Path) -> None:
    assert bars.rate(9, 10) == "90.0 % (55.5-99.7, n = 10)"
    assert area(np.array([False, False, True, True]), np.array([0.0, 1.0, 1.0, 2.0])) == 0.875
    usage = {"seconds": 3.0, "cpu_seconds": 2.0, "peak_mib": 400.0, "late": False}
    row = {**score_case(KEY, answer(("actuator_delay", "actuator:drive"))), **usage}
    text = report([row], [], "Title", {"regression": [{**row, "exact": False}]})
    for line in (
        "| exact set, chi2/dof >= 1.3 | 100.0 % (2.5-100.0, n = 1) |",
        "| exact set, chi2/dof 1.05-1.3 | - |",
        "| 95 % interval holds the truth | 100.0 % (2.5-100.0, n = 1) |",
        "| relative parameter error, noise 0.5-1.6 mrad | 0.1 (median of 1) |",
        "| memory per case, median, MiB | 400 |",
        "| actuator_delay | 1/1 | 1/1 | actuator_delay 1 |",
        "| regression | 0.0 % (0.0-97.5, n = 1) |",
    ):
        assert line in text
    draw_reliability([row], tmp_path / "reliability.png")
    assert (tmp_path / "reliability.png").read_bytes().startswith(b"\x89PNG")
