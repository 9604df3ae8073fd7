from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.shooting.point import FAILED, Point, total


def test_a_point_counts_all_segments() -> None:
    assert Point(np.zeros(1), np.zeros((2, 2)), np.array([1.5, 2.0])).chi2 == 3.5


def test_a_failed_segment_is_infinitely_bad() -> None:
    assert total(np.array([1.0, FAILED])) == np.inf
