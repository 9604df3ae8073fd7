from __future__ import annotations

import math

import pytest
import torch

from torch_activegp.data.angles import unwrap_angles
from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError


@pytest.mark.parametrize("speed", [-30.0, -1.0, 0.5, 30.0])
def test_a_turning_wheel_is_a_line(speed: float) -> None:
    time = torch.arange(200, dtype=torch.float64) * 0.1
    angle = 3.0 + speed * time
    wrapped = torch.remainder(angle + math.pi, 2 * math.pi) - math.pi
    recording = Recording.from_columns("a", {"time": time, "qpos.wheel": wrapped, "qpos.slide": 4 * (time % 2)})
    line = unwrap_angles(recording, ["wheel"])
    torch.testing.assert_close(line["qpos.wheel"], angle)
    assert torch.equal(line["qpos.slide"], recording["qpos.slide"])


def test_a_joint_that_was_not_recorded_is_refused() -> None:
    recording = Recording.from_columns("a", {"time": torch.arange(4.0), "qpos.x": torch.zeros(4)})
    with pytest.raises(DataError, match="a: no column `qpos.wheel`, found time, qpos.x"):
        unwrap_angles(recording, ["wheel"])
