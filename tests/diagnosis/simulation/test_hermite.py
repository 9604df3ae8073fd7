from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.simulation.hermite import position_between, velocity_between


def test_a_cubic_is_followed_exactly() -> None:
    position, velocity = np.polynomial.Polynomial([0.3, -1.2, 0.7, 2.0]), np.polynomial.Polynomial([-1.2, 1.4, 6.0])
    begin, h = 0.4, 0.25
    x = np.linspace(0.0, 1.0, 9)
    ends = (position(begin), position(begin + h), velocity(begin), velocity(begin + h))
    np.testing.assert_allclose(position_between(x, h, *ends), position(begin + x * h), atol=1e-14)
    np.testing.assert_allclose(velocity_between(x, h, *ends), velocity(begin + x * h), atol=1e-13)
