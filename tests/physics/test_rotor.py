from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.physics.rotor import Motion, carried

INERTIA, DT = 0.5, 0.01


def follow(motion: Motion, torque: np.ndarray, half: float = 0.1, begun: np.ndarray | None = None) -> tuple:
    """Offset, speed and side of one rotor."""
    begun = np.ones(len(torque), dtype=bool) if begun is None else begun
    found = carried(motion, torque[None], begun[None], DT, INERTIA, np.array([half]), 8)
    return tuple(float(each[0]) for each in found)


def at_rest(rows: int) -> Motion:
    return Motion(*(np.zeros((1, rows + 1)) for _ in range(3)))


def test_it_stays_where_it_pushes() -> None:
    assert follow(at_rest(30), np.full(30, 2.0)) == (0.1, 0.0, 1.0)
    assert follow(at_rest(30), np.full(30, -2.0)) == (-0.1, 0.0, -1.0)


def test_it_flies_through_the_gap_and_lands() -> None:
    torque = np.where(np.arange(60) < 10, 2.0, -2.0)
    seconds = np.sqrt(2 * 0.2 / (2.0 / INERTIA))  # for the whole gap
    rows = int(seconds / DT)
    off, speed, side = follow(at_rest(10 + rows), torque[: 10 + rows])
    assert side == 0.0
    assert off == pytest.approx(0.1 - 0.5 * 2.0 / INERTIA * (rows * DT) ** 2, abs=2e-3)
    assert speed == pytest.approx(-2.0 / INERTIA * rows * DT, rel=0.02)
    assert follow(at_rest(12 + rows), torque[: 12 + rows]) == (-0.1, 0.0, -1.0)


def test_a_joint_that_slows_down_leaves_it() -> None:
    """A joint that moves on and is braked: the rotor, which pushed it, flies on with its speed."""
    t = DT * np.arange(41)
    braked = np.where(t < 0.2, t, t - 2.5 * (t - 0.2) ** 2)[None]
    motion = Motion.along(braked, DT, 2)
    torque = np.where(np.arange(25) < 20, -0.01, 0.0)  # held back until then: it leaves the other end
    off, speed, side = follow(motion.at(np.array([0]), np.arange(26)[None]), torque)
    assert side == 0.0
    assert speed == pytest.approx(5.0 * 0.05, rel=0.15)
    assert off == pytest.approx(-0.1 + 2.5 * 0.05**2, rel=0.15)


def test_what_was_not_recorded_yet_does_not_count() -> None:
    torque = np.array([2.0] * 10 + [-2.0] * 2)
    begun = np.arange(12) >= 10
    assert follow(at_rest(12), torque, begun=begun) == (-0.1, 0.0, -1.0)


def test_motion_is_that_of_the_positions() -> None:
    t = DT * np.arange(50)
    motion = Motion.along((1.5 * t**2)[None], DT, 2)
    np.testing.assert_allclose(motion.acceleration, 3.0, rtol=1e-9)
    np.testing.assert_allclose(motion.velocity[0, 1:-1], 3.0 * t[1:-1])
    some = motion.at(np.array([0, 0]), np.array([[-3, 0, 4], [48, 49, 60]]))
    np.testing.assert_allclose(some.position[:, [0, -1]] / 1.5, [[0.0, t[4] ** 2], [t[48] ** 2, t[49] ** 2]])
    short = Motion.along(np.ones((1, 3)), DT, 2)
    assert not short.acceleration.any()
