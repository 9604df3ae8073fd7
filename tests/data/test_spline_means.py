from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.data.spline_means import spline_means


@pytest.mark.parametrize("columns", [(), (2,)])
def test_means_of_a_parabola_are_its_integrals_over_the_steps(columns: tuple[int, ...]) -> None:
    time, clock = np.array([0.0, 0.2, 0.3, 0.7, 1.0]), np.array([0.0, 0.5, 1.0, 1.0])
    shape = (-1, *(1 for _ in columns))
    values = np.ones((5, *columns)) * (time**2).reshape(shape)
    expected = np.ones((3, *columns)) * np.array([0.25 / 3, (1.0 - 0.125) / 1.5, 1.0]).reshape(shape)
    np.testing.assert_allclose(spline_means(time, values, clock), expected, atol=1e-12)
