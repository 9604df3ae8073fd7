from __future__ import annotations

import math

import pytest
import torch

from torch_activegp.data import Recording
from torch_activegp.experiments.control_step import choose_step


def swing(rate: float, *, dt: float = 0.002, seconds: float = 20.0, noise: float = 0.0) -> dict[str, torch.Tensor]:
    time = torch.arange(int(seconds / dt), dtype=torch.float64) * dt
    chance = torch.Generator().manual_seed(0)
    error = noise * torch.randn(len(time), generator=chance, dtype=torch.float64)
    return {"time": time, "qpos.a": torch.sin(rate * time) / rate, "qvel.a": torch.cos(rate * time) + error}


def recording(**columns: torch.Tensor) -> Recording:
    return Recording.from_columns("run", columns)


@pytest.mark.parametrize("rate", [1.0, 5.0])
def test_velocities_change_by_a_fifth_of_their_standard_deviation(rate: float) -> None:
    # the change over dt of cos(rate t) is 2 sin(rate dt / 2) standard deviations
    wanted = 2 * math.asin(0.1) / rate
    assert choose_step([recording(**swing(rate))]) == pytest.approx(wanted, abs=0.004)


def test_the_fastest_joint_and_run_decide() -> None:
    slow, fast = swing(1.0), swing(5.0)
    both = slow | {"qpos.b": fast["qpos.a"], "qvel.b": fast["qvel.a"], "qpos.c": 0 * slow["time"]}
    both["qvel.c"] = 0 * slow["time"]  # a joint that does not move has no say
    alone = choose_step([recording(**fast)])
    assert choose_step([recording(**both)]) == alone
    assert choose_step([recording(**slow), recording(**fast)]) == alone


def test_noise_makes_the_step_longer_but_is_not_mistaken_for_motion() -> None:
    quiet, loud = (choose_step([recording(**swing(1.0, dt=0.01, seconds=100.0, noise=noise))]) for noise in (0.0, 0.15))
    assert quiet == pytest.approx(0.2, abs=0.01)
    # three times the noise of 0.15 is 0.45 = 2 sin(dt / 2) / sqrt(2)
    assert loud == pytest.approx(2 * math.asin(0.45 / math.sqrt(2)), rel=0.2)


def test_a_coarse_or_short_recording_keeps_its_own_step() -> None:
    assert choose_step([recording(**swing(5.0, dt=0.1))]) == 0.1
    assert choose_step([recording(**swing(0.1, dt=0.01, seconds=2.02))]) == 0.02  # a hundred steps are left
    short = {
        "time": torch.arange(5).double() * 0.1,
        "qpos.a": torch.arange(5.0),
        "qvel.a": torch.tensor([10.0, 11, 10, 9, 10]),
    }
    assert choose_step([recording(**short)]) == 0.1
