from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.shooting.linearize import Linearization, linearize
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate


@pytest.fixture(scope="module")
def linear(bench) -> Linearization:
    return linearize(bench.shooting, bench.nominal)


def close(linear: np.ndarray, simulated: np.ndarray, share: float = 0.02) -> None:
    np.testing.assert_allclose(linear, simulated, atol=share * np.abs(simulated).max())


def test_the_response_to_a_force_equals_a_simulated_perturbation(bench, linear) -> None:
    wave = 0.01 * np.sin(np.arange(bench.segments.intervals) / 7.0)
    force = np.tile(wave, (bench.segments.size, 1))[..., None]
    moved = bench.predict(Candidate(force=force)) - bench.predict(NOMINAL)
    close(linear.respond_to_force(0, force)[..., 0], moved)


def test_the_response_to_a_start_equals_a_simulated_perturbation(bench, linear) -> None:
    shift = np.array([2e-3, -5e-3])
    moved = bench.predict(NOMINAL, bench.nominal.starts + shift) - bench.predict(NOMINAL)
    close(linear.respond_to_start() @ shift, moved)


def test_the_response_to_a_control_equals_a_simulated_perturbation(bench, linear) -> None:
    shove = np.zeros((bench.segments.size, bench.segments.intervals, 1))
    shove[:, 10:20] = 0.02
    moved = bench.predict(Candidate(shove=shove)) - bench.predict(NOMINAL)
    close(linear.respond(linear.control * shove[:, :, None])[..., 0], moved)


def test_a_linear_law_of_velocity_is_read_off_the_trajectories(bench, linear) -> None:
    speed = linear.states[:, :-1, linear.velocities[0], None]
    damped = Candidate((bench.effect("viscous_friction"),), (np.array([0.002]),))
    close(linear.respond_to_force(0, -0.002 * speed)[..., 0], bench.predict(damped) - bench.predict(NOMINAL), 0.05)


def test_the_states_are_the_fits_trajectories_where_it_is_close(bench) -> None:
    shooting = bench.shooting
    close_by = dataclasses.replace(bench.nominal, per_segment=np.zeros(bench.segments.size))
    far = dataclasses.replace(close_by, per_segment=np.where(np.arange(bench.segments.size) == 1, 1e9, 0.0))
    linear, other = linearize(shooting, close_by), linearize(shooting, far)
    np.testing.assert_array_equal(linear.states[..., linear.positions], bench.predict(NOMINAL))
    np.testing.assert_array_equal(np.delete(other.states, 1, 0), np.delete(linear.states, 1, 0))
    np.testing.assert_array_equal(other.states[1, :, other.positions][0], bench.segments.take("smooth")[1, :, 0])
    np.testing.assert_array_equal(other.states[1, :, other.velocities][0], bench.segments.take("velocity")[1, :, 0])
    assert linear.positions.tolist() == [0] and linear.velocities.tolist() == [1]
    assert linear.transition.shape == (bench.segments.size, bench.segments.intervals, 2, 2)


def test_effects_of_the_fit_are_in_the_transition(bench, linear) -> None:
    damped = dataclasses.replace(bench.nominal, effects=(bench.effect("viscous_friction"),), values=(np.array([0.5]),))
    faster = linear.transition[:, :, 1, 1] - linearize(bench.shooting, damped).transition[:, :, 1, 1]
    assert np.median(faster) == pytest.approx(0.5 / 0.33 * 0.01, rel=0.05)


def test_the_pull_is_the_transpose_of_the_response_to_a_force(linear) -> None:
    rng = np.random.default_rng(2)
    force = rng.normal(size=linear.force.shape[:2])
    gradient = rng.normal(size=(len(force), force.shape[1] + 1, 1))
    moved = linear.respond_to_force(0, force[..., None])[..., 0]
    assert (force * linear.pull(gradient)[..., 0]).sum() == pytest.approx((moved * gradient).sum(), rel=1e-9)


def test_some_segments_of_a_linearization_are_those_of_their_own(bench, linear) -> None:
    which = np.array([0, 3])
    own, picked = linearize(bench.shooting.pick(which), bench.nominal.pick(which)), linear.pick(which)
    for name in ("states", "transition", "force", "control"):
        np.testing.assert_allclose(getattr(picked, name), getattr(own, name), rtol=1e-6, atol=1e-12)


def test_the_same_question_is_answered_once(bench) -> None:
    first, work = linearize(bench.shooting, bench.nominal), bench.shooting.work
    assert linearize(bench.shooting, bench.nominal) is first
    assert bench.shooting.work == work
