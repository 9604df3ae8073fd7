from __future__ import annotations

import re

import numpy as np
import pytest

from torch_activegp.report.axis import Axis
from torch_activegp.report.chart import Chart, band, dots, level, line, steps, whiskers

X, Y = Axis("time [s]", 0.0, 10.0), Axis("angle [rad]", -1.0, 1.0)


def test_a_line_goes_through_its_points_with_up_being_up() -> None:
    mark = line("after", X, Y, ([0, 5, 10], [-1, 0, 1]), "model")
    assert mark.path == "M0.0 1000.0L500.0 500.0L1000.0 0.0"
    assert (mark.look, mark.label, mark.readable) == ("after", "model", True)


def test_a_line_breaks_where_a_value_is_missing() -> None:
    path = line("after", X, Y, ([0, 2, 4, 6, 8], [0, 0, np.nan, 0, None])).path  # type: ignore[list-item]
    assert path == "M0.0 500.0L200.0 500.0M600.0 500.0"


def test_a_long_line_keeps_its_peaks_and_ends() -> None:
    time = np.linspace(0, 10, 50_001)
    values = 0.1 * np.sin(time)
    values[31_234], values[400] = 0.9, -0.8
    path = line("after", X, Y, (time, values)).path
    points = np.array([pair.split() for pair in re.split("[ML]", path)[1:]], dtype=float)
    assert 600 <= len(points) <= 1300
    assert points[:, 1].min() == 50.0 and points[:, 1].max() == 900.0
    assert points[0, 0] == 0.0 and points[-1, 0] == 1000.0
    assert (np.diff(points[:, 0]) >= 0).all()


def test_an_endless_value_is_drawn_out_of_the_frame() -> None:
    assert line("after", X, Y, ([0, 1], [np.inf, -np.inf])).path == "M0.0 -2000.0L100.0 4000.0"


def test_steps_are_level_within_a_bin() -> None:
    assert steps("before", X, Y, ([0, 5, 10], [0, 1])).path == "M0.0 500.0L500.0 500.0L500.0 0.0L1000.0 0.0"


def test_bands_levels_dots_and_whiskers() -> None:
    assert band("noise", Y, (-0.5, 0.5)).path == "M0 750.0H1000V250.0H0Z"
    assert level("zero", Y, 0.0).path == "M0 500.0H1000"
    assert dots("dots", X, Y, ([1, 2, 3], [0, np.nan, 9])).path == "M100.0 500.0h.01"
    assert whiskers("whiskers", X, Y, ([1, 2], [-1, np.nan], [1, 1])).path == "M100.0 1000.0V0.0"


@pytest.mark.parametrize("count", [0, 1, 1500, 100_000])
def test_dots_stay_few(count: int) -> None:
    assert dots("dots", X, Y, (np.zeros(count), np.zeros(count))).path.count("M") <= min(count, 1500)


def test_a_chart_describes_itself() -> None:
    chart = Chart("All is well", X, Y, [line("after", X, Y, ([0], [0]), "model"), level("zero", Y, 0)])
    assert chart.description == "All is well. angle [rad] over time [s]: model."
