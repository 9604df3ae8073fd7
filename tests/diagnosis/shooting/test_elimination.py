from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.elimination import bounded_step, eliminate, invert, project


def test_the_eliminated_normal_equations_equal_a_dense_least_squares() -> None:
    rng = np.random.default_rng(0)
    design, columns, residual = rng.normal(size=(5, 20, 2)), rng.normal(size=(5, 20, 3)), rng.normal(size=(5, 20))
    linear = eliminate(design, columns, residual)
    delta = np.linalg.solve(linear.normal.sum(0), linear.gradient.sum(0))
    dense = np.zeros((100, 10 + 3))
    for s in range(5):
        dense[20 * s : 20 * (s + 1), 2 * s : 2 * s + 2] = design[s]
        dense[20 * s : 20 * (s + 1), 10:] = columns[s]
    wanted = np.linalg.lstsq(dense, residual.ravel(), rcond=None)[0]
    np.testing.assert_allclose(delta, wanted[10:], atol=1e-10)
    np.testing.assert_allclose(linear.states(delta, np.full(2, 1e6)).ravel(), wanted[:10], atol=1e-7)


@pytest.mark.parametrize("count", [3, 0])
def test_what_is_projected_is_the_sum_over_the_segments(count: int) -> None:
    rng = np.random.default_rng(1)
    design, columns, residual = rng.normal(size=(4, 9, 2)), rng.normal(size=(4, 9, count)), rng.normal(size=(4, 9))
    design[..., 1] *= 0.0
    normal, gradient = project(design, columns, residual)
    linear = eliminate(design, columns, residual)
    np.testing.assert_allclose(normal, linear.normal.sum(0), atol=1e-12)
    np.testing.assert_allclose(gradient, linear.gradient.sum(0), atol=1e-12)


def test_states_that_nothing_sees_stay_where_they_are() -> None:
    design = np.zeros((1, 6, 2))
    design[0, :, 0] = 1.0
    shift = eliminate(design, np.zeros((1, 6, 0)), np.ones((1, 6))).states(np.zeros(0), np.full(2, 1e6))
    np.testing.assert_allclose(shift, [[1.0, 0.0]], atol=1e-6)


def test_states_that_move_nothing_take_nothing_away() -> None:
    rng = np.random.default_rng(0)
    design, columns, residual = rng.normal(size=(4, 20, 2)), rng.normal(size=(4, 20, 3)), rng.normal(size=(4, 20))
    wider = np.zeros((4, 20, 4))
    wider[..., [1, 3]] = design
    less, more = eliminate(design, columns, residual), eliminate(wider, columns, residual)
    np.testing.assert_allclose(more.normal, less.normal)
    np.testing.assert_allclose(more.gradient, less.gradient)
    reach = np.full(4, 2.0)
    np.testing.assert_allclose(
        more.states(np.ones(3), reach)[:, [1, 3]], less.states(np.ones(3), reach[:2]), atol=1e-12
    )
    np.testing.assert_array_equal(more.states(np.ones(3), reach)[:, [0, 2]], 0.0)


def test_states_that_cannot_be_told_apart_share_what_is_left() -> None:
    """Where a simulation flies apart, one shows as the other does, by so much that no reach tells them apart."""
    design = np.full((1, 4, 2), 2.0**44)
    shift = eliminate(design, np.zeros((1, 4, 0)), np.full((1, 4), 2.0**40)).states(np.zeros(0), np.full(2, 1.0))
    np.testing.assert_allclose(shift, [[2.0**-5, 2.0**-5]], rtol=1e-6)


def test_other_segments_move_as_they_would_beside_one_that_cannot_be_solved() -> None:
    rng, reach = np.random.default_rng(0), np.full(2, 1e12)
    design, residual = rng.normal(size=(2, 4, 2)), rng.normal(size=(2, 4))
    design[0, :, 1] = 1e-9 * design[0, :, 1]
    alone = eliminate(design[:1], np.zeros((1, 4, 0)), residual[:1]).states(np.zeros(0), reach)
    design[1] = 2.0**44
    both = eliminate(design, np.zeros((2, 4, 0)), residual).states(np.zeros(0), reach)
    np.testing.assert_allclose(both[0], alone[0])
    assert np.isfinite(both).all()


def test_a_state_that_hardly_shows_moves_no_farther_than_its_reach() -> None:
    design = np.zeros((1, 6, 2))
    design[0, :, 0], design[0, 5, 1] = 1.0, 1e-3
    residual = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    free, held = (
        eliminate(design, np.zeros((1, 6, 0)), residual).states(np.zeros(0), np.array([1e9, reach]))
        for reach in (1e9, 0.5)
    )
    assert free[0, 1] > 900.0
    assert abs(held[0, 1]) < 0.5


def test_the_inverse_does_not_depend_on_units() -> None:
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(30, 3))
    units = np.array([1e-6, 1.0, 1e5])
    inverse = invert((columns * units).T @ (columns * units))
    np.testing.assert_allclose(inverse * np.outer(units, units), np.linalg.inv(columns.T @ columns), rtol=1e-8)


def test_a_step_stops_at_the_bound_and_the_others_make_up_for_it() -> None:
    normal, gradient = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-3.0, 3.0])
    at, low, high, little = np.array([0.0, 0.0]), np.array([0.0, -9.0]), np.array([9.0, 9.0]), np.ones(2)
    free = bounded_step(normal, gradient, 0.0, at, low - 9.0, high, little)
    np.testing.assert_allclose(free, np.linalg.solve(normal, gradient))
    np.testing.assert_allclose(bounded_step(normal, gradient, 0.0, at, low, high, little), [0.0, 1.5])
    np.testing.assert_allclose(bounded_step(normal, gradient, 1.0, at, low, high, little), [0.0, 0.75])


def test_a_step_is_the_same_in_all_units() -> None:
    """A stop's stiffness in N/m, next to its position in m."""
    normal, gradient = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([-3.0, 3.0])
    units = np.array([1e-6, 1e7])
    far = np.full(2, np.inf)
    step = bounded_step(normal * np.outer(units, units), gradient * units, 0.1, np.zeros(2), -far, far, 0.1 / units)
    np.testing.assert_allclose(step * units, bounded_step(normal, gradient, 0.1, np.zeros(2), -far, far, np.ones(2)))


def test_a_parameter_that_shows_nowhere_stays() -> None:
    normal, gradient, far = np.diag([2.0, 1e-24]), np.array([1.0, 1e-12]), np.full(2, np.inf)
    np.testing.assert_allclose(bounded_step(normal, gradient, 0.0, np.zeros(2), -far, far, np.ones(2)), [0.5, 0.0])


@pytest.mark.parametrize("damping", [0.0, 0.3, 10.0])
def test_a_step_gains_what_it_promises(damping: float) -> None:
    """Whatever step the states take beside that of the parameters, and none at all."""
    rng = np.random.default_rng(3)
    design, columns, residual = rng.normal(size=(4, 20, 2)), rng.normal(size=(4, 20, 3)), rng.normal(size=(4, 20))
    linear = eliminate(design, columns, residual)
    delta, reach = np.array([0.1, -0.2, 0.05]), np.full(2, 1e6)
    for shift in (linear.states(delta, reach, damping), np.zeros((4, 2))):
        left = residual - columns @ delta - np.einsum("smn,sn->sm", design, shift)
        assert linear.gain(delta, shift) == pytest.approx(float((residual**2 - left**2).sum()), rel=1e-6)


def test_damped_states_keep_what_shows_and_lose_what_hardly_does() -> None:
    """Two states that do almost the same: their sum shows, their difference hardly."""
    along, across = np.random.default_rng(4).normal(size=(2, 50))
    design = np.stack([along + 1e-3 * across, along - 1e-3 * across], axis=-1)[None]
    linear = eliminate(design, np.zeros((1, 50, 0)), (along + across)[None])
    whole, damped = (linear.states(np.zeros(0), np.full(2, 1e6), damping)[0] for damping in (0.0, 1e-2))
    assert abs(whole[0] - whole[1]) > 100.0
    assert damped.sum() == pytest.approx(whole.sum(), rel=0.2)
    assert abs(damped[0] - damped[1]) < 1.0
