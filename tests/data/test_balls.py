from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from torch_activegp.data.balls import BALLS, DROPS, balls_model, load_balls
from torch_activegp.errors import DataError


@pytest.mark.parametrize(("ball", "drop"), [("football", 1), ("golf_ball", 3)])
def test_an_unknown_ball_or_drop_is_refused(ball: str, drop: int) -> None:
    with pytest.raises(DataError, match=f"no drop {drop} of a ball `{ball}`: drop 1 or 2 of baseball, .* wanted"):
        load_balls(ball, drop)


@pytest.mark.parametrize("ball", BALLS)
@pytest.mark.parametrize("drop", DROPS)
def test_every_ball_falls_from_the_bridge(recordings_dir: Path, ball: str, drop: int) -> None:
    recording = load_balls(ball, drop)
    height = recording["qpos.height"].numpy()
    assert recording.name == f"{ball}_{drop}"
    assert recording.columns == ("time", "qpos.height")
    assert 40 < len(recording) < 60
    assert recording.dt == pytest.approx(1 / 15, rel=0.01)
    assert 45 < height[0] < 51 and 9 < height[-1] < 18
    assert np.all(np.diff(height[10:]) < 0)


def test_the_golf_ball_is_as_published(recordings_dir: Path) -> None:
    recording = load_balls("golf_ball", 1)
    assert len(recording) == 43
    np.testing.assert_allclose(recording["qpos.height"][:3].numpy(), [49.471774, 49.441712, 49.381589], atol=1e-6)
    np.testing.assert_allclose(recording.time[:3].numpy(), [0, 0.066667, 0.133333], atol=1e-6)


def test_the_nominal_model_falls_freely() -> None:
    model = mujoco.MjModel.from_xml_path(str(balls_model()))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, nstep=200)
    assert data.qvel[model.joint("height").dofadr[0]] == pytest.approx(-9.81)
    assert model.body("ball").mass[0] == 1.0
