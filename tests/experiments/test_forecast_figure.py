from __future__ import annotations

import dataclasses
from pathlib import Path

import matplotlib.image
import pytest
import torch

from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments.forecast import forecast
from torch_activegp.experiments.forecast_figure import draw_forecast
from torch_activegp.experiments.learn import Learned, learn
from torch_activegp.simulators import FunctionSimulator


@pytest.fixture
def outcome(slide: str, slide_run) -> Learned:
    return learn(slide, [slide_run()], [slide_run("held-out", seed=1, seconds=3.0)], max_points=30, dt=0.03)


def test_png_and_svg_are_the_same_bytes_for_the_same_outcome(outcome: Learned, tmp_path: Path) -> None:
    files = draw_forecast(outcome, tmp_path)
    assert [file.name for file in files] == ["forecast.png", "forecast.svg"]
    before = [file.read_bytes() for file in files]
    assert [file.read_bytes() for file in draw_forecast(outcome, tmp_path)] == before
    picture = matplotlib.image.imread(files[0])[..., :3]
    assert picture.min() < 0.5 < picture.max()
    text = files[1].read_text()
    for words in ("qpos.slide [m]", "Free run of held-out: NRMSE", "Windows of 1 s", "simulator + GP"):
        assert words in text


def test_angles_are_in_rad(rod: str, rod_run, tmp_path: Path) -> None:
    outcome = learn(rod, [rod_run()], [rod_run("c", seed=1, seconds=3.0)], max_points=30)
    assert "qpos.hip [rad]" in draw_forecast(outcome, tmp_path)[1].read_text()


def test_a_diverged_forecast_is_named_and_other_simulators_have_no_unit(outcome: Learned, tmp_path: Path) -> None:
    broken = FunctionSimulator(
        lambda state, action: state * torch.nan, outcome.simulator.state_space, outcome.simulator.action_space, 0.03
    )
    before = forecast(broken, outcome.runs, 1.0, outcome.scale)
    text = draw_forecast(dataclasses.replace(outcome, before=before, simulator=broken), tmp_path)[1].read_text()
    assert "NRMSE diverged alone" in text
    assert "qpos.slide [SI]" in text


def test_a_folder_that_cannot_be_written_is_named(outcome: Learned, tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="Cannot write to .*forecast.png"):
        draw_forecast(outcome, tmp_path / "nowhere")
