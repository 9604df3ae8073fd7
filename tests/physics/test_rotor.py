from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.physics.rotor import Motion, carried

INERTIA, DT = 0.5, 0.01


def follow(
    motion: Motion, torque: np.ndarray, half: float = 0.1, begun: np.ndarray | None = None, centred: bool = False
) -> tuple:
    """Offset, speed and side of one rotor."""
    begun = np.ones(len(torque), dtype=bool) if begun is None else begun
    found = carried(motion, torque[None], begun[None], INERTIA, np.array([half]), 8, np.array([centred]))
    return tuple(float(each[0]) for each in found)


def at_rest(rows: int) -> Motion:
    return Motion(DT * np.arange(rows + 1)[None], *(np.zeros((1, rows + 1)) for _ in range(3)))


def test_it_stays_where_it_pushes() -> None:
    assert follow(at_rest(30), np.full(30, 2.0)) == (0.1, 0.0, 1.0)
    assert follow(at_rest(30), np.full(30, -2.0)) == (-0.1, 0.0, -1.0)


def test_from_the_middle_it_flies_through_half_the_gap() -> None:
    off, speed, side = follow(at_rest(10), np.full(10, 0.5), centred=True)
    assert side == 0.0
    assert off == pytest.approx(0.5 * (0.5 / INERTIA) * (10 * DT) ** 2, rel=0.02)
    assert speed == pytest.approx(0.5 / INERTIA * 10 * DT)
    assert follow(at_rest(60), np.full(60, 0.5), centred=True) == (0.1, 0.0, 1.0)


@pytest.mark.parametrize("damping", [0.1, 2.0, 20.0])
def test_drag_slows_it_down(damping: float) -> None:
    torque, seconds, still = 0.1, 40 * DT, at_rest(40)
    found = carried(
        still,
        np.full((1, 40), torque),
        np.ones((1, 40), dtype=bool),
        INERTIA,
        np.ones(1),
        10,
        np.ones(1, bool),
        damping,
    )
    fastest, rate = torque / damping, damping / INERTIA
    speed = fastest * (1.0 - np.exp(-rate * seconds))
    assert found[1][0] == pytest.approx(speed, rel=0.05)
    assert found[0][0] == pytest.approx(fastest * seconds - speed / rate, rel=0.05)


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
    motion = Motion.along(braked, t[None], 2)
    torque = np.where(np.arange(25) < 20, -0.01, 0.0)  # held back until then: it leaves the other end
    off, speed, side = follow(motion.at(np.array([0]), np.arange(26)[None]), torque)
    assert side == 0.0
    assert speed == pytest.approx(5.0 * 0.05, rel=0.15)
    assert off == pytest.approx(-0.1 + 2.5 * 0.05**2, rel=0.15)


def test_what_was_not_recorded_yet_does_not_count() -> None:
    torque = np.array([2.0] * 10 + [-2.0] * 2)
    begun = np.arange(12) >= 10
    assert follow(at_rest(12), torque, begun=begun) == (-0.1, 0.0, -1.0)


def test_motion_is_that_of_the_positions_on_their_own_clock() -> None:
    rng = np.random.default_rng(0)
    t = np.stack([DT * np.arange(50), np.cumsum(DT * rng.uniform(0.5, 2.0, 50))])
    motion = Motion.along(1.5 * t**2, t, 2)
    np.testing.assert_allclose(motion.acceleration, 3.0, rtol=1e-9)
    np.testing.assert_allclose(motion.velocity[0, 1:-1], 3.0 * t[0, 1:-1])
    middle = 0.5 * (t[1, 2:] + t[1, :-2])
    np.testing.assert_allclose(motion.velocity[1, 1:-1], 3.0 * middle)
    some = motion.at(np.array([0, 0]), np.array([[-3, 0, 4], [48, 49, 60]]))
    np.testing.assert_allclose(some.position[:, [0, -1]] / 1.5, [[0.0, t[0, 4] ** 2], [t[0, 48] ** 2, t[0, 49] ** 2]])
    assert not Motion.along(np.ones((1, 3)), t[:1, :3], 2).acceleration.any()


def test_it_flies_by_the_clock_of_its_recording() -> None:
    """At half the rate, and with uneven steps, it is where it is on an even clock."""
    torque = np.where(np.arange(50) < 40, 2.0, -2.0)
    even = follow(at_rest(50), torque)
    still = [np.zeros((1, 26)) for _ in range(3)]
    slow = follow(Motion(2 * DT * np.arange(26)[None], *still), torque[::2])
    uneven = np.concatenate(
        [DT * np.arange(40), DT * (40 + np.array([0.0, 0.5, 2.5, 3.0, 6.0, 7.0, 8.0, 8.5, 9.0, 9.5, 10.0]))]
    )
    other = follow(Motion(uneven[None], *(np.zeros((1, 51)) for _ in range(3))), torque)
    assert even[2] == slow[2] == other[2] == 0.0
    assert slow[:2] == pytest.approx(even[:2])
    assert other[:2] == pytest.approx(even[:2])
