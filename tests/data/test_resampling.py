from __future__ import annotations

import pytest
import torch

from torch_activegp.data.recording import Recording
from torch_activegp.data.resampling import resample
from torch_activegp.errors import DataError


def ramp(time: torch.Tensor, ctrl: torch.Tensor) -> Recording:
    columns = {
        "time": time,
        "qpos.x": 2 * time + 1,
        "qvel.x": torch.full_like(time, 2.0),
        "ctrl.u": ctrl,
        "qfrc.x": -ctrl,
    }
    return Recording.from_columns("a", columns, run="r", notes=("first",), prescribed=("x",), video=True)


def test_a_multiple_of_the_step_keeps_rows_and_averages_controls(generator: torch.Generator) -> None:
    time = torch.arange(103, dtype=torch.float64) * 0.001 + 5
    ctrl = torch.randn(103, generator=generator, dtype=torch.float64)
    coarse = resample(ramp(time, ctrl), dt=0.01)
    assert len(coarse) == 11
    torch.testing.assert_close(coarse.time, time[::10], rtol=0, atol=1e-12)
    torch.testing.assert_close(coarse["qpos.x"], 2 * time[::10] + 1)
    torch.testing.assert_close(coarse["ctrl.u"][:10], ctrl[:100].reshape(10, 10).mean(dim=1))
    torch.testing.assert_close(coarse["ctrl.u"][10], (ctrl[100] + ctrl[101] + 8 * ctrl[102]) / 10)
    torch.testing.assert_close(coarse["qfrc.x"], -coarse["ctrl.u"])
    assert (coarse.run, coarse.notes) == ("r", ("first", "Resampled from 0.001 s to 0.01 s."))
    assert (coarse.prescribed, coarse.video) == (("x",), True)


def test_the_impulse_of_a_control_is_kept_on_an_irregular_clock(generator: torch.Generator) -> None:
    time = torch.cumsum(0.01 + 0.02 * torch.rand(400, generator=generator, dtype=torch.float64), dim=0)
    ctrl = torch.randn(400, generator=generator, dtype=torch.float64)
    coarse = resample(ramp(time, ctrl), dt=0.07)
    end = float(coarse.time[-1])
    held = torch.clamp(time[1:], max=end) - torch.clamp(time[:-1], max=end)
    assert float(coarse["ctrl.u"][:-1].sum() * 0.07) == pytest.approx(float((ctrl[:-1] * held).sum()), rel=1e-9)
    torch.testing.assert_close(coarse["qpos.x"], 2 * coarse.time + 1)
    torch.testing.assert_close(torch.diff(coarse.time), torch.full((len(coarse) - 1,), 0.07, dtype=torch.float64))


def test_resampling_a_simulated_run_leaves_its_law_in_place() -> None:
    """A mass under a held force: its velocity at the coarse step follows from the mean force exactly."""
    time = torch.arange(1001, dtype=torch.float64) * 0.001
    force = torch.sin(20 * time)
    velocity = torch.cat([torch.zeros(1, dtype=torch.float64), torch.cumsum(force[:-1] * 0.001, dim=0)])
    columns = {"time": time, "qpos.x": torch.cumsum(velocity, 0) * 0.001, "qvel.x": velocity, "ctrl.u": force}
    coarse = resample(Recording.from_columns("a", columns), dt=0.05)
    torch.testing.assert_close(torch.diff(coarse["qvel.x"]), 0.05 * coarse["ctrl.u"][:-1])


def test_its_own_step_makes_a_jittered_clock_even(generator: torch.Generator) -> None:
    time = 0.01 * (torch.arange(50) + 0.3 * torch.rand(50, generator=generator, dtype=torch.float64))
    recording = ramp(time, torch.zeros(50, dtype=torch.float64))
    even = resample(recording, dt=recording.dt)
    torch.testing.assert_close(torch.diff(even.time), torch.full((len(even) - 1,), recording.dt, dtype=torch.float64))


@pytest.mark.parametrize(
    ("dt", "message"),
    [
        (0.005, "a step of at least 0.01 s .its own. wanted, found 0.005 s"),
        (0.0, "found 0 s"),
        (float("nan"), "found nan s"),
        (0.2, "a step of 0.2 s leaves 3 rows of 0.49 s, at least 4 wanted"),
    ],
)
def test_an_impossible_step_is_refused(dt: float, message: str) -> None:
    time = torch.arange(50, dtype=torch.float64) * 0.01
    with pytest.raises(DataError, match=message):
        resample(ramp(time, time), dt)
