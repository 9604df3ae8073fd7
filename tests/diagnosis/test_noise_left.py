from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.signal import lfilter

from torch_activegp.diagnosis.engine import NOMINAL
from torch_activegp.diagnosis.noise_left import quieter
from torch_activegp.diagnosis.noise_model import NoiseModel


def with_noise(bench, level: float, scale: float, pole: float = 0.0):
    """The likelihood and the fit of a perfect model whose noise is said to be of some level."""
    rng = np.random.default_rng(3)
    exact = bench.engine.predict(bench.segments, bench.nominal.starts[None], [NOMINAL])[0][0]
    fresh = rng.normal(size=(exact.shape[0], 200 + exact.shape[1], exact.shape[2]))
    coloured = lfilter([np.sqrt(1 - pole**2)], [1, -pole], fresh, axis=1)[:, 200:]
    segments = dataclasses.replace(bench.segments, position=exact + scale * coloured)
    shooting = dataclasses.replace(bench.shooting, segments=segments, noise=NoiseModel.white(np.array([level])))
    return shooting, shooting.fit([((), ())], bench.nominal.starts)[0]


@pytest.mark.parametrize("pole", [0.0, 0.7])
def test_noise_that_was_thought_too_loud_is_seen(clean, pole) -> None:
    shooting, fit = with_noise(clean, 1e-2, 1e-3, pole)
    found = quieter(shooting, fit)
    assert found is not None
    assert found.innovation[0] == pytest.approx(1e-3 * np.sqrt(1 - pole**2), rel=0.12)
    assert found.colour.any() == (pole > 0.0)
    again = dataclasses.replace(shooting, noise=found)
    assert quieter(again, again.fit([((), ())], fit.starts)[0]) is None


@pytest.mark.parametrize("level", [1e-3, 3e-4])
def test_noise_is_never_made_louder(clean, level) -> None:
    shooting, fit = with_noise(clean, level, 1e-3)
    assert quieter(shooting, fit) is None


def test_too_few_values_and_failed_simulations_say_nothing(clean) -> None:
    shooting, fit = with_noise(clean, 1e-2, 1e-3)
    few = shooting.pick(np.arange(2))
    assert quieter(few, fit.pick(np.arange(2))) is None
    assert quieter(shooting, dataclasses.replace(fit, starts=fit.starts * np.nan)) is None


@pytest.mark.parametrize(("level", "seen"), [(1e-2, True), (1.7e-4, False)])
def test_under_what_is_left_of_physics_high_differences_say_how_loud_noise_can_be(clean, level, seen: bool) -> None:
    """A slow error below the noise that was thought is white behind no filter; a level twice too high stays."""
    shooting, fit = with_noise(clean, level, 1e-4)
    time = np.arange(shooting.segments.intervals + 1) / 100
    slow = 3e-3 * np.sin(2 * np.pi * 6.0 * time)[None, :, None]
    segments = dataclasses.replace(shooting.segments, position=shooting.segments.position + slow)
    found = quieter(dataclasses.replace(shooting, segments=segments), fit)
    assert (found is not None) == seen
    if found is not None:
        assert found.scale[0] == pytest.approx(1e-4, rel=0.1)
        assert not found.colour.any()


@pytest.mark.parametrize(("floor", "louder"), [(1e-2, True), (3e-4, False)])
def test_noise_that_was_taken_too_low_rises_again_below_the_floor(clean, floor, louder: bool) -> None:
    shooting, fit = with_noise(clean, 3e-4, 1e-3, 0.7)
    found = quieter(shooting, fit, NoiseModel.white(np.array([floor])))
    assert (found is not None) == louder
    if found is not None:
        assert found.innovation[0] == pytest.approx(1e-3 * np.sqrt(1 - 0.7**2), rel=0.12)


def test_noise_is_not_below_what_rigid_bodies_hold(clean) -> None:
    shooting, fit = with_noise(clean, 1e-2, 1e-9)
    spread = np.sqrt(np.mean([run.position.var(axis=0) for run in shooting.segments.runs], axis=0))
    found = quieter(shooting, fit)
    assert found is not None
    assert found.innovation[0] == pytest.approx(3e-5 * spread[0], rel=1e-6)
    again = dataclasses.replace(shooting, noise=found)
    assert quieter(again, fit) is None
