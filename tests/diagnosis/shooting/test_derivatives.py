from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.derivatives import Derivatives

FLAT = np.array([0.05])


@pytest.fixture
def damped(bench):
    """Viscous friction, and a fit with derivatives by it too."""
    effects, values = (bench.effect("viscous_friction"),), (FLAT,)
    near = bench.shooting.fit([(effects, values)], bench.nominal.starts, 2)[0]
    assert near.columns is not None

    def derivatives(near=None, **said) -> Derivatives:
        return Derivatives(dataclasses.replace(bench.shooting, **said), effects, values, near)

    return derivatives, dataclasses.replace(near, values=values, taken=FLAT)


def test_without_a_fit_near_by_all_is_moved_once(damped, bench) -> None:
    by, starts = damped[0](), bench.nominal.starts
    assert not by.take_lent(FLAT)
    candidates, states = by.ask(FLAT, starts, held=False)
    assert len(candidates) == len(states) == 1 + len(bench.shooting.state_columns(starts)) + 1
    white = bench.shooting.residuals_from(states, candidates)
    assert by.take(white, FLAT, held=False)
    assert by.age == 0
    assert not by.stale
    assert by.design.shape[-1] == len(candidates) - 2
    assert by.columns.shape == (*white.shape[1:], 1)
    assert len(by.ask(FLAT + 1.0, starts, held=False)[0]) == 1


def test_what_a_fit_lends_needs_no_simulation(damped, bench) -> None:
    make, near = damped
    by = make(near)
    assert by.stale
    assert by.take_lent(FLAT)
    assert by.age == 1
    np.testing.assert_array_equal(by.design, near.design)
    np.testing.assert_array_equal(by.columns, near.columns_of(near.effects, near.values)[0][..., None])
    assert len(by.ask(FLAT, bench.nominal.starts, held=False)[0]) == 1
    assert not by.take_lent(FLAT)  # once


def test_held_parameters_are_not_moved(damped, bench) -> None:
    make, near = damped
    by = make(near)
    by.hold()
    assert by.columns.shape[-1] == 0
    by = make()
    by.hold()
    assert by.columns is None
    candidates, states = by.ask(FLAT, bench.nominal.starts, held=True)
    assert len(candidates) == 1 + len(bench.shooting.state_columns(bench.nominal.starts))
    by.take(bench.shooting.residuals_from(states, candidates), FLAT, held=True)
    assert by.columns.shape[-1] == 0


@pytest.mark.parametrize("states", [False, True])
def test_what_led_astray_is_taken_anew(damped, bench, states) -> None:
    make, near = damped
    by = make(near)
    by.take_lent(FLAT)
    by.lent = True
    by.forget(states=states)
    assert by.lent
    assert by.columns is None
    assert (by.design is None) is states
    moved = len(bench.shooting.state_columns(bench.nominal.starts)) if states else 0
    assert len(by.ask(FLAT, bench.nominal.starts, held=False)[0]) == 1 + moved + 1
    by.forget(misled=True)
    assert not by.lent


def test_a_step_promises_what_is_left_along_what_is_seen(damped, bench) -> None:
    make, near = damped
    by = make(near)
    by.take_lent(FLAT)
    by.linearise(0.5 * by.columns[..., 0])
    normal, gradient = by.linear.normal.sum(0), by.linear.gradient.sum(0)
    np.testing.assert_allclose(np.linalg.solve(normal, gradient), 0.5)


def test_another_fit_lends_its_own(damped, bench) -> None:
    make, near = damped
    by = make()
    by.lend(near, FLAT)
    assert by.design is near.design
    assert by.take_lent(FLAT)
