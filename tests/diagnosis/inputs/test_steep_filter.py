from __future__ import annotations

import pytest

from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter


@pytest.mark.parametrize(("corner", "rows"), [(0.4, 1), (0.26, 1), (0.24, 2), (0.1, 5), (0.02, 25)])
def test_noise_is_new_after_half_a_period_of_the_corner(corner: float, rows: int) -> None:
    assert SteepFilter(corner, 1e-3).rows == rows
