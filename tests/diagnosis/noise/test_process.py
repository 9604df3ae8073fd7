"""White accelerations beside noise of positions: the filter against a dense covariance, and the densities found."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.segments import Segments, cut
from torch_activegp.diagnosis.noise.process import Differences, likeliest_density

SCALE, DENSITY = np.array([1e-3, 2e-3]), np.array([0.05, 0.2])


def wandering(time: np.ndarray) -> np.ndarray:
    """Covariance of positions under a white acceleration of unit density, from rest at time 0."""
    early, late = np.minimum(time[:, None], time), np.maximum(time[:, None], time)
    return early**2 * (late - early / 3.0) / 2.0


def times(segments: Segments, number: int) -> np.ndarray:
    return np.concatenate([[0.0], np.cumsum(segments.dt[number])])


@pytest.fixture
def segments(make_plain_run) -> Segments:
    """Segments with an uneven clock, missing rows, and a first part that is not scored."""
    rng = np.random.default_rng(0)
    recorded = rng.random(300) > 0.2
    recorded[[0, -1]] = True
    laid = cut([make_plain_run(np.zeros(300), recorded)], 0.5, 0.1)
    laid = dataclasses.replace(laid, dt=laid.dt * (1.0 + 0.3 * rng.random(laid.dt.shape)))
    assert laid.size > 3 and not laid.counts.all()
    return laid


def test_the_filter_is_that_of_the_dense_covariance(segments: Segments) -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(size=(2, *segments.counts.shape, 2))
    differences = Differences.of(segments)
    white = differences.whiten(values, differences.factor(SCALE, DENSITY))
    assert not white[:, ~segments.counts].any()
    for number, counts in enumerate(segments.counts):
        dense = wandering(times(segments, number)[counts])
        for channel, (scale, density) in enumerate(zip(SCALE, DENSITY, strict=True)):
            covariance = scale**2 * np.eye(len(dense)) + density**2 * dense
            told = values[:, number, counts, channel]
            wanted = np.einsum("ni,ij,mj->nm", told, np.linalg.inv(covariance), told)
            ours = white[:, number, :, channel]
            np.testing.assert_allclose(ours @ ours.T, wanted, rtol=1e-6)


def test_the_diagonal_holds_the_determinant_of_the_differences(segments: Segments) -> None:
    """Up to that of the differences themselves, which is the same for all densities."""
    differences = Differences.of(segments)
    volumes = []
    for density in (0.0, 0.05):
        diagonal = differences.factor(SCALE[:1], np.array([density]))[:, 0, :, 0].T
        told = np.where(differences.known, np.log(diagonal), 0.0).sum(axis=1)
        dense = [
            np.linalg.slogdet(SCALE[0] ** 2 * np.eye(c.sum()) + density**2 * wandering(times(segments, s)[c]))[1] / 2
            for s, c in enumerate(segments.counts)
        ]
        volumes.append(told - dense)
    np.testing.assert_allclose(volumes[0], volumes[1], atol=1e-6)


def test_without_an_acceleration_it_divides_by_the_noise(segments: Segments) -> None:
    values = np.random.default_rng(1).normal(size=(*segments.counts.shape, 2))
    differences = Differences.of(segments)
    white = differences.whiten(values, differences.factor(SCALE, np.zeros(2)))
    np.testing.assert_allclose(white, np.where(segments.counts[..., None], values / SCALE, 0.0), rtol=1e-6, atol=1e-6)


def test_the_transpose_is_one(segments: Segments) -> None:
    one, other = np.random.default_rng(1).normal(size=(2, *segments.counts.shape, 2))
    differences = Differences.of(segments)
    factor = differences.factor(SCALE, DENSITY)
    forth = (differences.whiten(one, factor) * other).sum()
    assert (one * differences.unwhiten(other, factor)).sum() == pytest.approx(forth, rel=1e-9)


@pytest.mark.parametrize("density", [0.0, 0.01, 0.05])
def test_finds_an_acceleration_beside_what_initial_states_take_away(make_plain_run, density: float) -> None:
    rng = np.random.default_rng(2)
    laid = cut([make_plain_run(np.zeros(4001))], 0.8, 0.0)
    time = times(laid, 0)
    root = np.linalg.cholesky(wandering(time[1:]))
    moved = np.pad(density * rng.normal(size=(laid.size, len(time) - 1)) @ root.T, ((0, 0), (1, 0)))
    lines = rng.normal(size=(laid.size, 1)) + rng.normal(size=(laid.size, 1)) * time
    found, gain = likeliest_density(laid, moved + lines + 1e-3 * rng.normal(size=moved.shape), 1e-3)
    assert found == pytest.approx(density, rel=0.2, abs=5e-4)
    assert (gain > 10.0) == (density > 0.0) and gain >= 0.0


def test_few_values_show_no_acceleration(make_plain_run) -> None:
    laid = cut([make_plain_run(np.zeros(4001))], 0.8, 0.0)
    series = np.random.default_rng(0).normal(size=laid.counts.shape)
    assert likeliest_density(laid, series, 1e-3)[0] > 0.0
    for counts in (np.zeros_like(laid.counts), np.arange(laid.counts.shape[1]) % 20 == 0):
        few = dataclasses.replace(laid, counts=laid.counts & counts)
        some = few.pick(np.arange(40)) if few.counts.any() else few
        assert likeliest_density(some, series[: some.size], 1e-3) == (0.0, 0.0)
