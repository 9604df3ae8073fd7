from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import scipy.io

from torch_activegp.data.multiarm import load_multiarm, multiarm_model
from torch_activegp.errors import DataError


def test_an_unknown_split_is_refused() -> None:
    with pytest.raises(DataError, match="MultiArm has no split `all`: one of train, test wanted"):
        load_multiarm("all")


@pytest.mark.parametrize(("split", "rows", "start"), [("train", 36668, 0.0), ("test", 18333, 36.668)])
def test_the_pieces_are_one_recording(recordings_dir: Path, split: str, rows: int, start: float) -> None:
    recording = load_multiarm(split)
    assert recording.columns == ("time", "qpos.arm")
    assert len(recording) == rows
    assert float(recording.time[0]) == pytest.approx(start)
    steps = np.diff(recording.time.numpy())
    np.testing.assert_allclose(steps, 1e-3, rtol=1e-6)
    assert abs(float(recording["qpos.arm"].mean()) - np.pi) < 0.01


def test_the_nominal_model_is_the_authors_own(recordings_dir: Path) -> None:
    path = recordings_dir / "multiarm_single" / "EstimatedParameters_SinglePendulum.mat"
    distance, mass, inertia, viscous, gravity = scipy.io.loadmat(path)["EstimatedParameters"][0]
    model = mujoco.MjModel.from_xml_path(str(multiarm_model()))
    data = mujoco.MjData(model)
    for angle, speed in ((1.0, 0.0), (np.pi, 2.0), (4.0, -3.0)):
        data.qpos[0], data.qvel[0] = angle, speed
        mujoco.mj_forward(model, data)
        wanted = (mass * gravity * distance * np.sin(angle) - viscous * speed) / (inertia + mass * distance**2)
        assert data.qacc[0] == pytest.approx(wanted, rel=1e-6, abs=1e-9)
