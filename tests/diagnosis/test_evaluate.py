"""Errors of forecasts against an independent simulation, and what is refused."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from torch_activegp.data import Recording
from torch_activegp.diagnosis import evaluate
from torch_activegp.errors import DataError
from torch_activegp.simulators import Pendulum

Record = Callable[..., Recording]

NO_CONTROL = (
    "no control is recorded (ctrl.drive); taken as 0. If the machine was driven, nothing can explain its motion so: "
    "record them."
)


def test_a_right_model_errs_by_the_noise_and_a_wrong_one_by_more(record: Record) -> None:
    right = evaluate(model_text(), [record("none", 3)], nthread=1)
    wrong = evaluate(model_text(), [record("bump", 3)], nthread=1)
    assert set(right) == {"runs", "one_step", "free_run", "notes"}
    assert right["notes"] == []
    assert right["free_run"]["error"] < 1.2 * right["free_run"]["noise"]
    assert wrong["free_run"]["error"] > 3 * wrong["free_run"]["noise"]
    assert wrong["one_step"]["error"] > right["one_step"]["error"]


def test_noise_is_that_of_the_recording_in_its_standard_deviations(record: Record) -> None:
    run = record("none", 3)
    found = evaluate(model_text(), [run], nthread=1)
    expected = 1e-3 / run["qpos.hip"].std().item()
    assert found["free_run"]["noise"] == pytest.approx(expected, rel=0.3)


def test_every_run_and_channel_has_its_own_entry_and_the_whole_is_their_rms(record: Record) -> None:
    found = evaluate(model_text(), [record("bump", 3, "a"), record("bump", 4, "b")], nthread=1)
    assert [(entry["run"], entry["channel"]) for entry in found["runs"]] == [("a", "qpos.hip"), ("b", "qpos.hip")]
    for kind in ("one_step", "free_run"):
        errors = [entry[kind]["error"] for entry in found["runs"]]
        assert set(found["runs"][0][kind]) == {"error", "noise"}
        assert found[kind]["error"] == pytest.approx(np.sqrt(np.mean(np.square(errors))))


def test_degrees_are_refused(record: Record) -> None:
    run = record("none", 3)
    columns = {name: run[name] for name in run.columns}
    degrees = Recording.from_columns("swing", columns | {"qpos.hip": torch.rad2deg(run["qpos.hip"])})
    with pytest.raises(DataError, match=r'swing, column `qpos.hip`: rad or m wanted.*unit = "deg"'):
        evaluate(model_text(), [degrees], nthread=1)


def test_a_control_in_another_unit_is_doubted(record: Record) -> None:
    run = record("none", 3)
    columns = {name: run[name] for name in run.columns}
    thousandths = Recording.from_columns("swing", columns | {"ctrl.drive": 1e-3 * run["ctrl.drive"]})
    (note,) = evaluate(model_text(), [thousandths], nthread=1)["notes"]
    assert note.startswith("Column `ctrl.drive`: the unit seems to be another one.")


def test_what_was_decided_about_the_recordings_is_noted(record: Record) -> None:
    run = record("none", 3, "a")
    columns = {name: run[name] for name in run.columns if name != "ctrl.drive"}
    still = Recording.from_columns("b", columns, notes=("Columns left out: x.",))
    position = run["qpos.hip"].clone()
    position[50] += 0.5
    found = evaluate(model_text(), [run.replace({"qpos.hip": position}), still], nthread=1)
    assert found["notes"] == [
        "b: Columns left out: x.",
        "b: " + NO_CONTROL,
        f"a: a row left out, at {run.time[50]:.6g} s: qpos.hip is far from where the rows around it put it.",
    ]
    assert found["free_run"]["error"] == pytest.approx(
        evaluate(model_text(), [run, still])["free_run"]["error"], rel=0.1
    )


def test_a_piece_too_short_to_be_forecast_does_not_count(record: Record) -> None:
    whole, other = record("none", 3, "a"), record("none", 4, "b")
    scrap = Recording.from_columns("b", {name: other[name][:30] for name in ("time", "qpos.hip", "ctrl.drive")})
    found = evaluate(model_text(), [whole, scrap], nthread=1)
    assert [entry["run"] for entry in found["runs"]] == ["a"]
    assert any(note.startswith("b: lasts less than 0.6 s and is not forecast") for note in found["notes"])


def test_no_recording_is_refused() -> None:
    with pytest.raises(DataError, match="at least one"):
        evaluate(model_text(), [])


def test_a_simulator_in_torch_is_evaluated(black: Any) -> None:
    right = evaluate(black.simulator(), [black.record("none", 3)])
    wrong = evaluate(black.simulator(), [black.record("viscous spring", 3)])
    assert right["free_run"]["error"] < 1.2 * right["free_run"]["noise"]
    assert wrong["free_run"]["error"] > 10 * wrong["free_run"]["noise"]


def test_a_recording_of_other_joints_is_refused_for_a_simulator_in_torch(record: Record) -> None:
    with pytest.raises(DataError, match="the model has no joint `hip`; its joints are theta"):
        evaluate(Pendulum(), [record()])


def model_text() -> str:
    return """<mujoco model="pendulum"><option timestep="0.005" integrator="RK4"/><worldbody>
    <body name="rod"><joint name="hip" axis="0 1 0"/>
    <inertial pos="0 0 -0.5" mass="1" diaginertia="0.08 0.08 0.001"/></body></worldbody>
    <actuator><motor name="drive" joint="hip"/></actuator></mujoco>"""


def test_a_prescribed_joint_is_followed_and_not_scored(double: Any) -> None:
    """The rig's torque is not known: only with its motion as an input does the right model forecast the elbow."""
    model, held = double.model(), double.record(5, noise=double.noise)
    right = evaluate(model, [held], nthread=1)
    assert [entry["channel"] for entry in right["runs"]] == ["qpos.elbow"]
    assert right["free_run"]["error"] < 1.3 * right["free_run"]["noise"]
    assert right["one_step"]["error"] < 3 * right["one_step"]["noise"]
    assert any(note.startswith("Prescribed: shoulder.") for note in right["notes"])
    free = evaluate(model, [dataclasses.replace(held, prescribed=())], nthread=1)
    assert free["free_run"]["error"] > 100 * right["free_run"]["error"]
