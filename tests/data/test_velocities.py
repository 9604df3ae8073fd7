from __future__ import annotations

import math

import pytest
import torch
from scipy.signal import savgol_coeffs

from torch_activegp.data.local_polynomial import local_slope
from torch_activegp.data.recording import Recording
from torch_activegp.data.velocities import WINDOWS, choose_window, estimate_velocities
from torch_activegp.errors import ConfigurationError, DataError


def swing(
    noise: float, dt: float, rows: int, jitter: float, generator: torch.Generator
) -> tuple[Recording, torch.Tensor]:
    """A sine of 0.8 Hz and its true velocity."""
    time = dt * (torch.arange(rows) + jitter * torch.rand(rows, generator=generator, dtype=torch.float64))
    omega = 2 * math.pi * 0.8
    position = torch.sin(omega * time) + noise * torch.randn(rows, generator=generator, dtype=torch.float64)
    return Recording.from_columns("swing", {"time": time, "qpos.arm": position}), omega * torch.cos(omega * time)


def rms(values: torch.Tensor) -> float:
    return float(values.square().mean().sqrt())


@pytest.mark.parametrize("jitter", [0.0, 0.4])
@pytest.mark.parametrize("dt", [0.002, 0.01, 0.02])
@pytest.mark.parametrize("noise", [1e-4, 1e-3, 1e-2])
def test_the_chosen_window_is_nearly_the_best_one(
    noise: float, dt: float, jitter: float, generator: torch.Generator
) -> None:
    recording, truth = swing(noise, dt, 2000, jitter, generator)
    error = (estimate_velocities(recording)["qvel.arm"] - truth)[100:-100]
    best = min(
        rms((local_slope(recording.time, recording["qpos.arm"], window) - truth)[100:-100]) for window in WINDOWS
    )
    assert rms(error) < 1.8 * best
    differences = torch.gradient(recording["qpos.arm"], spacing=(recording.time,))[0]
    assert rms(error) < 0.5 * rms((differences - truth)[100:-100])


def test_a_clean_recording_keeps_the_narrowest_window(generator: torch.Generator) -> None:
    recording, truth = swing(0.0, 0.01, 500, 0.0, generator)
    assert rms(estimate_velocities(recording)["qvel.arm"] - truth) < 1e-4
    assert estimate_velocities(recording).notes == ("Velocities are slopes of local cubics over arm 5 rows.",)


def test_noise_alone_is_averaged_as_far_as_it_goes(generator: torch.Generator) -> None:
    time = torch.arange(1000, dtype=torch.float64) * 0.01
    noise = torch.randn(1000, generator=generator, dtype=torch.float64)
    window = choose_window(time, noise, noise=1.0)
    assert window == WINDOWS[-1]
    weights = savgol_coeffs(window, 3, deriv=1, delta=0.01)
    assert rms(local_slope(time, noise, window)[100:-100]) == pytest.approx((weights**2).sum() ** 0.5, rel=0.5)


@pytest.mark.parametrize("rows", [15, 40, 100])
def test_a_window_takes_at_most_a_third_of_the_run(rows: int, generator: torch.Generator) -> None:
    time = torch.arange(rows, dtype=torch.float64)
    window = choose_window(time, torch.randn(rows, generator=generator, dtype=torch.float64), noise=10.0)
    assert window == max(width for width in WINDOWS if width <= max(5, rows // 3))


def test_a_recorded_velocity_is_kept(generator: torch.Generator) -> None:
    recording, truth = swing(0.0, 0.01, 100, 0.0, generator)
    measured = recording.replace({"qvel.arm": truth + 0.01})
    assert estimate_velocities(measured) is measured
    both = estimate_velocities(measured.replace({"qpos.leg": 2 * recording["qpos.arm"]}))
    assert torch.equal(both["qvel.arm"], truth + 0.01)
    assert rms(both["qvel.leg"] - 2 * truth) < 1e-3


def test_the_caller_may_choose_the_window(generator: torch.Generator) -> None:
    recording, _ = swing(1e-3, 0.01, 100, 0.0, generator)
    velocity = estimate_velocities(recording, window=21)["qvel.arm"]
    assert torch.equal(velocity, local_slope(recording.time, recording["qpos.arm"], 21))
    with pytest.raises(ConfigurationError, match="found 20"):
        estimate_velocities(recording, window=20)


def test_a_short_run_is_refused(generator: torch.Generator) -> None:
    recording, _ = swing(0.0, 0.01, 14, 0.0, generator)
    with pytest.raises(DataError, match="swing: too short for velocities, 15 rows wanted, found 14"):
        estimate_velocities(recording)
