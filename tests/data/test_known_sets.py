from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from torch_activegp.data.known_sets import KNOWN_MODELS, known_model, known_names, known_recordings
from torch_activegp.errors import DataError


@pytest.mark.parametrize("name", known_names())
def test_every_recording_fits_its_model(recordings_dir: Path, name: str) -> None:
    model = mujoco.MjModel.from_xml_path(known_model(name.partition(":")[0]))
    joints = {model.joint(index).name for index in range(model.njnt)}
    actuators = {model.actuator(index).name for index in range(model.nu)}
    for recording in known_recordings(name):
        assert set(recording.joints) == joints
        assert set(recording.actuators) == actuators


def test_the_balls_with_a_number_keep_it(recordings_dir: Path) -> None:
    (recording,) = known_recordings("balls:whiffle_ball_2_1")
    assert recording.name == "whiffle_ball_2_1"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("silverbox:train", "unknown data set `silverbox:train`: emps:train, emps:test, multiarm:train"),
        ("emps:trian", "EMPS has no split `trian`"),
        ("multiarm:", "MultiArm has no split ``"),
        ("laas:speed", "LAAS has no recording `speed`"),
        ("balls:golf_ball", "no drop 0 of a ball `golf_ball`: drop 1 or 2"),
        ("balls:football_1", "no drop 1 of a ball `football`"),
    ],
)
def test_an_unknown_name_says_what_there_is(name: str, message: str) -> None:
    with pytest.raises(DataError, match=message):
        known_recordings(name)


def test_an_unknown_model_says_what_there_is() -> None:
    with pytest.raises(DataError, match="no public data set `arm` with a model: one of emps, multiarm, laas, balls"):
        known_model("arm")
    assert all(Path(known_model(name)).is_file() for name in KNOWN_MODELS)
