from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.noise.model import NoiseModel, colour_family


def filtered(poles: tuple[float, float], rows: int, seed: int = 0) -> np.ndarray:
    """Autoregressive noise from innovations of unit variance, after it forgot its start."""
    fresh = np.random.default_rng(seed).normal(size=rows + 500)
    out = np.zeros(rows + 500)
    for k in range(2, len(out)):
        out[k] = poles[0] * out[k - 1] + poles[1] * out[k - 2] + fresh[k]
    return out[500:]


def correlation(values: np.ndarray, lag: int) -> float:
    return float(np.corrcoef(values[lag:], values[:-lag])[0, 1])


@pytest.mark.parametrize("poles", [(0.7, 0.0), (1.4, -0.49)])
def test_whitening_makes_autoregressive_noise_white(make_plain_run, poles) -> None:
    noise = filtered(poles, 20001)
    segments = cut([make_plain_run(noise)], 1e9, 0.0)
    model = NoiseModel(np.array([noise.std()]), np.array([poles]))
    assert model.innovation[0] == pytest.approx(1.0, rel=0.05)
    white = model.whiten(segments, noise[None, :, None])[0]
    assert correlation(noise, 1) > 0.6
    assert abs(correlation(white, 1)) < 0.03 and abs(correlation(white, 2)) < 0.03
    assert white.std() == pytest.approx(1.0, rel=0.05)


def test_whitening_leaves_white_noise_alone_but_for_its_level(make_plain_run) -> None:
    noise = np.random.default_rng(0).normal(size=101)
    segments = cut([make_plain_run(noise)], 1e9, 0.0)
    model = NoiseModel.white(np.array([2.0]))
    assert model.innovation == pytest.approx([2.0])
    np.testing.assert_allclose(model.whiten(segments, noise[None, :, None])[0], noise / 2.0)


def test_whitening_is_linear_and_zero_where_nothing_counts(make_plain_run) -> None:
    recorded = np.ones(60, dtype=bool)
    recorded[20:23] = False
    segments = cut([make_plain_run(np.zeros(60), recorded)], 0.3, 0.1)
    model = NoiseModel(np.array([0.5]), np.array([[0.7, 0.1]]))
    one, other = np.random.default_rng(0).normal(size=(2, *segments.position.shape))
    both = model.whiten(segments, np.stack([one, other]))
    np.testing.assert_allclose(model.whiten(segments, 2 * one - other), 2 * both[0] - both[1])
    assert not both[0][~segments.counts].any()
    assert both[0][segments.counts].all()


@pytest.mark.parametrize("poles", [(0.0, 0.0), (0.7, 0.1)])
def test_columns_are_whitened_one_by_one(make_plain_run, poles) -> None:
    segments = cut([make_plain_run(np.zeros(60))], 0.3, 0.1)
    model = NoiseModel(np.array([0.5, 2.0]), np.array([poles, (0.4, 0.0)]))
    columns = np.random.default_rng(0).normal(size=(*segments.counts.shape, 2, 3))
    white = model.whiten_columns(segments, columns)
    for number in range(3):
        np.testing.assert_allclose(white[..., number], model.whiten(segments, columns[..., number]))
    assert model.whiten_columns(segments, columns[..., :0]).shape == (*white.shape[:2], 0)
    columns[0, 5, 1, 0] = np.nan
    assert np.isfinite(model.whiten_columns(segments, columns)).all()


def test_behind_a_missing_row_a_value_is_only_scaled(make_plain_run) -> None:
    recorded = np.ones(30, dtype=bool)
    recorded[10] = False
    segments = cut([make_plain_run(np.zeros(30), recorded)], 1e9, 0.0)
    white = NoiseModel(np.array([2.0]), np.array([[0.5, 0.0]])).whiten(segments, np.ones((1, 30, 1)))[0]
    np.testing.assert_allclose(white[[0, 1, 11, 12]], 0.5)
    np.testing.assert_allclose(white[[5, 13, 29]], 0.5 * 0.5 / np.sqrt(0.75))


def test_every_colour_of_the_family_is_stationary() -> None:
    for first, second in colour_family():
        assert (np.abs(np.roots([1.0, -first, -second])) < 1.0).all()
        assert NoiseModel(np.ones(1), np.array([[first, second]])).innovation[0] > 1e-3
    assert colour_family()[0] == (0.0, 0.0)


@pytest.mark.parametrize("poles", [(0.0, 0.0), (0.7, 0.0), (1.4, -0.49)])
def test_unwhitening_is_the_transpose_of_whitening(make_plain_run, poles) -> None:
    recorded = np.ones(60, dtype=bool)
    recorded[20:23] = False
    segments = cut([make_plain_run(np.zeros(60), recorded)], 0.3, 0.1)
    model = NoiseModel(np.array([0.5]), np.array([poles]))
    rng = np.random.default_rng(1)
    residual = rng.normal(size=segments.position.shape)
    white = rng.normal(size=model.whiten(segments, residual).shape)
    along = (model.whiten(segments, residual) * white).sum()
    assert (residual * model.unwhiten(segments, white)).sum() == pytest.approx(along, rel=1e-12)


def test_slow_errors_of_a_colour_are_louder_than_what_is_new_in_them() -> None:
    noise = NoiseModel(np.array([1.0, 2.0, 1.0]), np.array([[0.0, 0.0], [0.6, 0.0], [0.5, 0.3]]))
    rng = np.random.default_rng(0)
    for channel, (first, second) in enumerate(noise.colour):
        fresh = noise.innovation[channel] * rng.normal(size=400_000)
        seen = lfilter([1.0], [1.0, -first, -second], fresh)
        slow = seen.reshape(-1, 400).mean(axis=1).std() * 20.0  # the mean of so many values, times their root
        assert noise.slow[channel] == pytest.approx(slow, rel=0.06)


def test_beside_an_acceleration_columns_and_transpose_are_those_of_the_filter(make_plain_run) -> None:
    """The first channel has an acceleration, the second one a colour."""
    recorded = np.random.default_rng(1).random(60) > 0.1
    segments = cut([make_plain_run(np.zeros(60), recorded)], 0.3, 0.1)
    model = NoiseModel(np.array([0.5, 2.0]), np.array([(0.0, 0.0), (0.4, 0.1)]), np.array([30.0, 0.0]))
    columns = np.random.default_rng(0).normal(size=(*segments.counts.shape, 2, 3))
    white = model.whiten_columns(segments, columns)
    for number in range(3):
        np.testing.assert_allclose(white[..., number], model.whiten(segments, columns[..., number]))
    still = model.of_positions.whiten(segments, columns[..., 0])
    assert still.reshape(*segments.counts.shape, 2)[..., 1] == pytest.approx(
        white[..., 0].reshape(*segments.counts.shape, 2)[..., 1]
    )
    assert not np.allclose(still, white[..., 0])
    other = np.random.default_rng(2).normal(size=white.shape[:-1])
    forth = (white[..., 0] * other).sum()
    assert (columns[..., 0] * model.unwhiten(segments, other)).sum() == pytest.approx(forth, rel=1e-9)
