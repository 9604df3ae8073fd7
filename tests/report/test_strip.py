from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from torch_activegp.report.axis import Axis
from torch_activegp.report.strip import BOUNDS, cells, legend, level_of, spans

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


def test_segments_of_different_lengths_leave_no_gap() -> None:
    """Lengths of 1, 0.5, 0.5 and 2 s, side by side."""
    found = cells(AXIS, [0.5, 1.25, 1.75, 3.0], [1.0, 1.0, 1.0, 1.0])
    assert all(one.start + one.width == pytest.approx(two.start, abs=0.11) for one, two in pairwise(found))
    assert found[0].start < 60
    assert found[-1].start + found[-1].width == pytest.approx(1000, abs=100)


def test_a_segment_without_a_value_is_left_blank_and_the_others_stay() -> None:
    found = cells(AXIS, [0.5, 1.5, 2.5, 3.5], [1.0, None, 20.0, 500.0])
    assert [(cell.start, cell.width) for cell in found] == [(0, 250), (500, 250), (750, 250)]


def test_segments_of_known_lengths_leave_what_was_not_used() -> None:
    found = cells(AXIS, [0.5, 2.0], [1.0, 2.0], [0.4, 1.0])
    assert [(cell.start, cell.width) for cell in found] == [(75, 100), (375, 250)]
    (alone,) = cells(AXIS, [2.0], [1.0], [1.0])
    assert (alone.start, alone.width) == (375, 250)


def test_spans_meet_midway() -> None:
    left, right = spans(np.array([0.5, 1.5, 3.0]))
    assert left.tolist() == [0.0, 1.0, 2.25]
    assert right.tolist() == [1.0, 2.25, 3.75]
    assert [end.tolist() for end in spans(np.array([2.0]))] == [[1.5], [2.5]]
