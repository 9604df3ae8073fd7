from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from torch_activegp.report.traces import traces


@pytest.mark.parametrize(
    ("verdict", "heading"),
    [
        ("none", "On runs that it never saw, the simulator is off by 0.2 % of the motion"),
        ("named", "On runs that the fit never saw, the error falls from 240 % to the noise, 0.2 %"),
        ("unknown", "On runs that the fit never saw, the error falls from 31 % to 18 %"),
    ],
)
def test_the_heading_is_the_finding(fakes: Any, verdict: str, heading: str) -> None:
    assert traces(*fakes[verdict]()).heading.replace("\u00a0", " ") == heading


def test_a_worse_correction_is_not_praised(fakes: Any) -> None:
    diagnosis, evidence = fakes["unknown"]()
    diagnosis["fit"]["holdout"]["free_run"]["after"] = 0.5
    assert "goes from 31" in traces(diagnosis, evidence).heading


def test_where_a_run_cannot_be_forecast_freely_the_error_is_that_by_one_step(fakes: Any) -> None:
    diagnosis, evidence = fakes["unknown"]()
    diagnosis["fit"]["holdout"] |= {"one_step": {"before": 0.2, "after": 0.1}, "runs": [{"predictable": False}]}
    assert "the error by one step falls from 20\u00a0% to 10\u00a0%" in traces(diagnosis, evidence).heading


@pytest.mark.parametrize(
    ("after", "gp", "words"),
    [
        (0.18, 0.03, "the error falls from 31 % to 18 %, and with a learned force to 3 %"),
        (0.31, 0.03, "the error falls with a learned force from 31 % to 3 %"),
        (0.18, 0.2, "the error falls from 31 % to 18 %"),
    ],
)
def test_what_a_learned_force_gains_is_told(fakes: Any, after: float, gp: float, words: str) -> None:
    diagnosis, evidence = fakes["unknown"]()
    diagnosis["fit"]["holdout"]["free_run"] |= {"before": 0.31, "after": after, "gp": gp}
    assert traces(diagnosis, evidence).heading.replace("\u00a0", " ").endswith(words)


@pytest.mark.parametrize(
    ("after", "words"), [(0.00215, "to the noise"), (0.003, "to 1.5 times the noise, 0.3 %"), (0.01, "to 1 %")]
)
def test_the_noise_is_what_is_close_to_it(fakes: Any, after: float, words: str) -> None:
    diagnosis, evidence = fakes["named"]()
    diagnosis["fit"]["holdout"]["free_run"]["after"] = after
    assert words in traces(diagnosis, evidence).heading.replace("\u00a0", " ")


def test_a_pair_shows_trace_and_error_with_the_noise(fakes: Any) -> None:
    content = traces(*fakes["named"]()).content
    assert (len(content["pairs"]), len(content["more"]), content["left_out"]) == (3, 1, 0)
    upper, lower = content["pairs"][0]
    assert [mark.look for mark in upper.marks] == ["measured", "before", "after"]
    assert [mark.look for mark in lower.marks] == ["noise", "before", "after"]
    assert (upper.y.label, lower.y.label, lower.y.log) == ("qpos.elbow [rad]", "rms error [rad]", True)
    assert upper.title.replace("\u00a0", " ").endswith("0.34 mrad, noise 0.3 mrad")


def test_white_noise_stays_in_its_band() -> None:
    random = np.random.default_rng(0)
    time, noise = np.arange(6000) / 500, 0.01
    measured = np.sin(time)
    before = measured + noise * random.standard_normal(6000)
    trace = {"run": "r", "channel": "qpos.a", "unit": "rad", "noise": noise, "after": None, "gp": None}
    trace |= {"time": time.tolist(), "measured": measured.tolist(), "before": before.tolist()}
    ((_, lower),) = traces({"verdict": "none"}, {"traces": [trace]}).content["pairs"]
    ends = [float(part) for part in lower.marks[0].path[1:-3].replace("H1000V", " ").split()[1:]]
    heights = np.array([float(point.split()[1]) for point in lower.marks[1].path[1:].split("L")])
    inside = (heights <= max(ends)) & (heights >= min(ends))
    assert len(heights) == 60 and 0.85 <= inside.mean() <= 1.0


def test_equal_models_are_drawn_once_and_a_gp_has_its_line_and_column(fakes: Any) -> None:
    upper, _ = traces(*fakes["none"]()).content["pairs"][0]
    assert [mark.look for mark in upper.marks] == ["measured", "before"]
    diagnosis, evidence = fakes["unknown"]()
    diagnosis["fit"]["holdout"]["runs"][0]["free_run"] = {"before": 0.31, "after": 0.18, "noise": 0.002, "gp": 0.03}
    content = traces(diagnosis, evidence).content
    assert "gp" in [mark.look for mark in content["pairs"][0][0].marks]
    assert content["gp"] and content["rows"][0]["gp"] == "3\u00a0%"


def test_little_is_said_of_little() -> None:
    assert traces({"verdict": "named"}, {}) is None
    total = {"free_run": {"before": 0.5}}
    section = traces({"verdict": "named", "fit": {"holdout": total}}, {})
    assert section.heading == "Forecasts of runs that the fit never saw"
    assert [row["run"] for row in section.content["rows"]] == ["all"]
    short = {"run": "r", "channel": "qpos.a", "time": [0.0], "measured": [1.0]}
    assert len(traces({"verdict": "named"}, {"traces": [short] * 30}).content["more"]) == 21


def test_a_model_that_ran_away_is_said_and_drawn_out_of_the_frame(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    evidence["traces"][0]["before"][1200:] = [float("inf")] * 1200
    upper, lower = traces(diagnosis, evidence).content["pairs"][0]
    assert "rms error \u221e \u2192 0.34" in upper.title.replace("\u00a0rad", "").replace("\u00a0", " ")
    assert lower.y.high < 1.0
