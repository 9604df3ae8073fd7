from __future__ import annotations

import math

import pytest
import torch

from torch_activegp.data import Recording
from torch_activegp.experiments.nominal import nominal_simulator
from torch_activegp.experiments.recorded import with_velocities
from torch_activegp.experiments.transitions import transitions_of


def ramp(rows: int = 40) -> Recording:
    time = torch.arange(rows).double() * 0.005
    return Recording.from_columns(
        "ramp",
        {"time": time + 7.0, "qpos.slide": 2.0 * time, "qvel.slide": 0 * time + 2, "ctrl.push": torch.arange(rows)},
    )


def test_transitions_follow_the_clock_and_the_held_control(slide: str) -> None:
    data = transitions_of(ramp(), nominal_simulator(slide, 0.02))
    assert data["time"].tolist() == pytest.approx([0.02 * index for index in range(9)])
    assert data["state"][:, 0].tolist() == pytest.approx([0.04 * index for index in range(9)])
    assert data["action"][:, 0].tolist() == pytest.approx([4 * index + 1.5 for index in range(9)])


@pytest.mark.parametrize(("shifts", "clocks"), [(1, 1), (2, 2), (4, 4), (9, 4)])
def test_shifted_clocks_use_more_rows(slide: str, shifts: int, clocks: int) -> None:
    data = transitions_of(ramp(rows=400), nominal_simulator(slide, 0.02), shifts)
    assert len(data) == 99 * clocks
    starts = data["time"][data["time"] < 0.02 - 1e-9]
    assert starts.tolist() == pytest.approx([0.02 * index / clocks for index in range(clocks)])
    assert data["state"][:, 0].tolist() == pytest.approx((2 * data["time"]).tolist())


def test_a_short_run_has_no_room_for_other_clocks(slide: str) -> None:
    assert len(transitions_of(ramp(rows=17), nominal_simulator(slide, 0.02), 4)) == 4


def test_angles_come_back_wrapped(rod: str, rod_run) -> None:
    simulator = nominal_simulator(rod, 0.02)
    data = transitions_of(with_velocities(rod_run(), simulator), simulator)
    for key in ("state", ("next", "state")):
        assert data[key][:, 0].abs().max() <= math.pi
    change = simulator.state_space.difference(data["next", "state"], data["state"])[:, 0]
    torch.testing.assert_close(change, 0.01 * (data["state"] + data["next", "state"])[:, 1], atol=2e-3, rtol=0)
