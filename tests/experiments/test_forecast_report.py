from __future__ import annotations

import dataclasses
import json
import math

import pytest
import torch

from torch_activegp.experiments.forecast import forecast
from torch_activegp.experiments.forecast_report import predictions, summary
from torch_activegp.experiments.learn import Learned, learn
from torch_activegp.simulators import FunctionSimulator


@pytest.fixture
def outcome(rod: str, rod_run) -> Learned:
    return learn(rod, [rod_run()], [rod_run("c", seed=1), rod_run("d", seed=2, seconds=2.0)], max_points=40, dt=0.025)


def test_the_summary_is_plain_and_complete(outcome: Learned) -> None:
    values = json.loads(json.dumps(summary(outcome), allow_nan=False))
    assert values["held_out"] == ["c", "d"]
    fit = values["fit"]["holdout"]
    assert list(fit) == ["one_step", "window", "free_run"]
    assert fit["window"]["before"] == outcome.before.window.position_nrmse
    assert fit["window"]["after"] == values["errors"]["window"]["simulator_and_gp"]["nrmse"]["qpos.hip"]
    assert fit["window"]["noise"] == outcome.noise
    assert values["errors"]["one_step"]["simulator"]["rmse"] == outcome.before.one_step.rmse
    assert values["guard"]["stepped_in"] == bool((outcome.learned.trust < 1).any())
    assert values["guard"]["windows"] == outcome.window_guard
    assert values["dt"] == 0.025


def test_a_diverged_forecast_is_null(outcome: Learned) -> None:
    broken = FunctionSimulator(
        lambda state, action: state * torch.nan, outcome.simulator.state_space, outcome.simulator.action_space, 0.025
    )
    diverged = dataclasses.replace(outcome, before=forecast(broken, outcome.runs, 1.0, outcome.scale))
    values = json.loads(json.dumps(summary(diverged), allow_nan=False))
    assert values["fit"]["holdout"]["free_run"]["before"] is None
    errors = values["errors"]["free_run"]["simulator"]
    assert errors["rmse"] == {"qpos.hip": None, "qvel.hip": None}
    assert errors["diverged_after"] == 0.025
    assert predictions(diverged)["qpos.hip.simulator"].isna().all()


def test_predictions_hold_every_free_run(outcome: Learned) -> None:
    table = predictions(outcome)
    assert list(table) == [
        "run",
        "time",
        *(f"qpos.hip.{kind}" for kind in ("measured", "simulator", "simulator_and_gp")),
    ]
    assert table["run"].value_counts().to_dict() == {"c": len(outcome.runs[0]), "d": len(outcome.runs[1])}
    first = table[table["run"] == "c"]
    assert first["time"].tolist() == pytest.approx([0.025 * (k + 1) for k in range(len(first))])
    assert first["qpos.hip.measured"].tolist() == outcome.runs[0]["next", "state"][:, 0].tolist()
    # errors of the table are those of the summary; the angle is the turn nearest to the measured one
    error = table["qpos.hip.simulator_and_gp"] - table["qpos.hip.measured"]
    assert error.abs().max() <= math.pi
    assert (error**2).mean() ** 0.5 == pytest.approx(outcome.after.free_run.rmse["qpos.hip"])
