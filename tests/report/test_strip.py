from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.report.axis import Axis
from torch_activegp.report.strip import BOUNDS, cells, legend, level_of

AXIS = Axis("time [s]", 0.0, 4.0)


def test_cells_tile_the_run() -> None:
    found = cells(AXIS, [0.5, 1.5, 2.5, 3.5], [1.0, 1.5, 20.0, 500.0])
    assert [(cell.start, cell.width) for cell in found] == [(0, 250), (250, 250), (500, 250), (750, 250)]
    assert [cell.level for cell in found] == [0, 1, 4, 6]
    assert found[2].text == "2.5 s: 20"


def test_many_cells_are_joined_and_keep_the_worst() -> None:
    time = np.linspace(0.01, 3.99, 400)
    values = np.ones(400)
    values[123] = 50.0
    found = cells(AXIS, time.tolist(), values.tolist())
    assert len(found) == 80
    assert sorted(cell.level for cell in found)[-2:] == [0, 5]


@pytest.mark.parametrize(("time", "values"), [([], []), ([1.0], [None]), ([None], [1.0])])
def test_nothing_gives_no_cell(time: list[float | None], values: list[float | None]) -> None:
    assert cells(AXIS, time, values) == []


def test_one_segment_fills_the_run() -> None:
    (cell,) = cells(AXIS, [2.0], [1.0])
    assert (cell.start, cell.width) == (0, 1000)


def test_levels_and_their_legend() -> None:
    assert [level_of(bound) for bound in BOUNDS] == [1, 2, 3, 4, 5, 6]
    assert [text for _, text in legend()] == [
        "under 1.3", "1.3\u20132", "2\u20134", "4\u201310", "10\u201330", "30\u2013100", "over 100",
    ]  # fmt: skip
