from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.simulation.hermite import fill_rows, position_between, velocity_between


def test_a_cubic_is_followed_exactly() -> None:
    position, velocity = np.polynomial.Polynomial([0.3, -1.2, 0.7, 2.0]), np.polynomial.Polynomial([-1.2, 1.4, 6.0])
    begin, h = 0.4, 0.25
    x = np.linspace(0.0, 1.0, 9)
    ends = (position(begin), position(begin + h), velocity(begin), velocity(begin + h))
    np.testing.assert_allclose(position_between(x, h, *ends), position(begin + x * h), atol=1e-14)
    np.testing.assert_allclose(velocity_between(x, h, *ends), velocity(begin + x * h), atol=1e-13)


def test_rows_between_uneven_time_steps_are_filled_each_by_its_own_time() -> None:
    position, velocity = np.polynomial.Polynomial([0.3, -1.2, 0.7, 2.0]), np.polynomial.Polynomial([-1.2, 1.4, 6.0])
    dt = np.random.default_rng(0).uniform(0.001, 0.003, (4, 8))
    time = np.pad(np.cumsum(dt, axis=1), ((0, 0), (1, 0)))
    wanted = np.stack([position(time), -2.0 * position(time), velocity(time), -2.0 * velocity(time)], axis=-1)
    edges = [0, 3, 6, 8]  # the last step is shorter
    states = np.full_like(wanted, np.nan)
    states[:, edges] = wanted[:, edges]
    fill_rows(states, edges, dt, nq=2)
    np.testing.assert_allclose(states, wanted, atol=1e-12)
