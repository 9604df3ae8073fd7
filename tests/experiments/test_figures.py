from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

import matplotlib
import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.image import imread

from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments import figures
from torch_activegp.experiments.figures import draw_figures
from torch_activegp.experiments.methods import METHODS


def table(methods: list[str], trials: int = 2, episodes: int = 3) -> pd.DataFrame:
    rows = [
        (method, trial, episode, 10 * episode, 1.0 - 0.1 * episode, 10.0**-trial, 0.3 + 0.01 * number)
        for number, method in enumerate(methods)
        for trial in range(trials)
        for episode in range(1, episodes + 1)
    ]
    return pd.DataFrame(
        rows, columns=["method", "trial", "episode", "num_points", "max_variance", "mse", "discrepancy"]
    )


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> dict[str, Figure]:
    """The figures by name, instead of files."""
    found: dict[str, Figure] = {}

    def keep(figure: Figure, stem: Path) -> list[Path]:
        found[stem.name] = figure
        return [stem]

    monkeypatch.setattr(figures, "save_picture", keep)
    return found


def test_each_figure_is_written_twice_and_always_the_same(tmp_path: Path) -> None:
    contents = []
    before = dict(matplotlib.rcParams)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        files = draw_figures(table(["discrepancy", "opax"]), tmp_path / name, "title", prior_mse=0.1)
        contents.append({file.name: file.read_bytes() for file in files})
    assert dict(matplotlib.rcParams) == before
    names = {f"{stem}.{kind}" for stem in ("max_variance", "mse", "discrepancy", "figures") for kind in ("png", "svg")}
    assert set(contents[0]) == names == {path.name for path in (tmp_path / "a").iterdir()}
    assert contents[0] == contents[1]
    assert ElementTree.fromstring(contents[0]["figures.svg"]).tag.endswith("svg")
    assert imread(tmp_path / "a" / "figures.png").shape[1] > 1500


def test_lines_are_means_and_bands_reach_from_smallest_to_largest(drawn: dict[str, Figure]) -> None:
    draw_figures(table(["sigma"], trials=3), Path(), "title", unit="rad", prior_mse=0.25)
    (axes,) = drawn["mse"].axes
    line, simulator = axes.get_lines()
    np.testing.assert_allclose(line.get_xydata(), [[episode, 1.11 / 3] for episode in (1, 2, 3)])
    assert set(simulator.get_ydata()) == {0.25}
    (band,) = (item for item in axes.collections if isinstance(item, PolyCollection))
    heights = band.get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == (0.01, 1.0)
    assert axes.get_yscale() == "log"
    assert axes.get_ylabel() == "mean squared error [(rad)²]"
    assert drawn["discrepancy"].axes[0].get_ylabel() == "mean |p0 - f| [rad]"
    assert drawn["figures"].get_suptitle() == "title"


def test_methods_differ_in_colour_and_style_and_keep_them(drawn: dict[str, Figure]) -> None:
    draw_figures(table(list(METHODS)), Path(), "all")
    lines = drawn["max_variance"].axes[0].get_lines()
    everyone = {line.get_label(): (line.get_color(), line.get_linestyle()) for line in lines}
    assert list(everyone) == [method.title for method in METHODS.values()]
    assert len({color for color, _ in everyone.values()}) == len(METHODS)
    draw_figures(table(["random", "sigma"]), Path(), "two")
    for line in drawn["max_variance"].axes[0].get_lines():
        assert everyone[line.get_label()] == (line.get_color(), line.get_linestyle())
    (legend,) = drawn["figures"].legends
    assert [text.get_text() for text in legend.get_texts()] == ["Sigma-greedy", "Random"]


def test_differences_of_no_weight_stay_invisible(drawn: dict[str, Figure]) -> None:
    flat = table(["sigma"])
    flat["max_variance"] = 1.0 - 1e-10 * flat["episode"]
    draw_figures(flat, Path(), "flat")
    low, high = drawn["max_variance"].axes[0].get_ylim()
    assert low < 0.9 < 1.0 < high
    flat["discrepancy"] = 0.0
    draw_figures(flat, Path(), "nothing")
    low, high = drawn["discrepancy"].axes[0].get_ylim()
    assert low == 0 < high


def test_one_episode_is_a_point_and_episodes_are_whole(drawn: dict[str, Figure]) -> None:
    draw_figures(table(["sigma"], episodes=1), Path(), "one")
    (axes,) = drawn["mse"].axes
    assert axes.get_lines()[0].get_marker() == "o"
    draw_figures(table(["sigma"], episodes=3), Path(), "three")
    ticks = drawn["mse"].axes[0].get_xticks()
    assert all(tick == int(tick) for tick in ticks)


def test_a_folder_that_is_gone_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="Cannot write to .*max_variance.png"):
        draw_figures(table(["sigma"]), tmp_path / "gone", "title")
