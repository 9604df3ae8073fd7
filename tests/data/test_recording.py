from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from tensordict import TensorDict

from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError

TIME = np.arange(50) * 0.02


@pytest.fixture
def recording() -> Recording:
    columns = {
        "time": TIME,
        "qpos.arm.elbow": np.sin(TIME),
        "qpos.slide": torch.from_numpy(TIME**2),
        "qvel.slide": list(2 * TIME),
        "ctrl.motor": np.ones(50, dtype=np.float32),
        "qfrc.slide": 0 * TIME,
    }
    return Recording.from_columns("a.csv", columns, run="7", source=Path("a.csv"), notes=("said",))


def test_columns_lie_in_a_tensordict_in_float64(recording: Recording) -> None:
    assert isinstance(recording.data, TensorDict)
    assert recording.data.batch_size == torch.Size([50])
    assert {recording[name].dtype for name in recording.columns} == {torch.float64}
    assert torch.equal(recording.data["qpos", "arm.elbow"], torch.from_numpy(np.sin(TIME)))
    assert torch.equal(recording["qvel.slide"], torch.from_numpy(2 * TIME))


def test_columns_and_tensordict_stay_the_same(recording: Recording) -> None:
    with pytest.raises(RuntimeError, match="lock"):
        recording.data["qpos", "slide"] = torch.zeros(50, dtype=torch.float64)
    again = copy.deepcopy(recording)
    again.data["qpos", "slide"][3] = 5.0
    assert again["qpos.slide"][3] == again.data["qpos", "slide"][3] == 5.0
    assert recording["qpos.slide"][3] != 5.0


def test_what_it_says_of_itself(recording: Recording) -> None:
    assert len(recording) == 50
    assert recording.dt == pytest.approx(0.02)
    assert recording.joints == ("arm.elbow", "slide")
    assert recording.actuators == ("motor",)
    assert recording.columns == ("time", "qpos.arm.elbow", "qpos.slide", "qvel.slide", "ctrl.motor", "qfrc.slide")
    assert "qvel.slide" in recording
    assert "qvel.arm.elbow" not in recording
    sentence = (
        "a.csv (run 7): 50 rows, 0.98 s at 50 Hz; joints arm.elbow, slide; actuators motor; no velocity of arm.elbow"
    )
    assert str(recording) == sentence
    assert repr(recording) == f"<Recording {sentence}>"


def test_prescribed_joints_are_kept_and_said(recording: Recording) -> None:
    columns = {name: recording[name] for name in recording.columns}
    given = Recording.from_columns("a.csv", columns, prescribed=("slide",), video=True)
    assert str(given).endswith("; no velocity of arm.elbow; prescribed: slide")
    replaced = given.replace({"ctrl.motor": torch.zeros(50)})
    assert (replaced.prescribed, replaced.video) == (("slide",), True)
    with pytest.raises(
        DataError, match=r"a\.csv: no column `qpos\.knee`, and `knee` is said to be prescribed; found time"
    ):
        Recording.from_columns("a.csv", columns, prescribed=("knee",))


def test_the_median_step_ignores_a_dropped_row() -> None:
    time = np.delete(TIME, [10, 11])
    assert Recording.from_columns("a", {"time": time, "qpos.x": time}).dt == pytest.approx(0.02)


def test_the_caller_keeps_his_arrays() -> None:
    time = TIME.copy()
    recording = Recording.from_columns("a", {"time": time, "qpos.x": time})
    time += 1
    assert recording.time[0] == 0


def test_replace_adds_to_a_copy(recording: Recording) -> None:
    more = recording.replace({"qvel.arm.elbow": torch.cos(recording.time)}, note="added")
    assert more.notes == ("said", "added")
    assert (more.run, more.source, more.name) == (recording.run, recording.source, recording.name)
    assert set(more.columns) - set(recording.columns) == {"qvel.arm.elbow"}
    assert torch.equal(more["ctrl.motor"], recording["ctrl.motor"])
    assert "no velocit" not in str(more)


def test_pickle_round_trip(recording: Recording) -> None:
    again = pickle.loads(pickle.dumps(recording))
    assert str(again) == str(recording)
    assert all(torch.equal(again[name], recording[name]) for name in recording.columns)


def test_a_missing_column_lists_what_is_there(recording: Recording) -> None:
    with pytest.raises(DataError, match=r"a.csv \(run 7\): no column `qpos.knee`, found time, qpos.arm.elbow"):
        recording["qpos.knee"]


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"time": TIME, "qpos.x": TIME[:, None]}, r"column `qpos.x`: shape \(T,\) wanted, found \(50, 1\)"),
        ({"time": TIME, "qpos.x": np.where(TIME > 0.5, np.nan, 1)}, "row 27, column `qpos.x`"),
        ({"time": TIME, "run": TIME, "qpos.x": TIME}, "unknown column `run`"),
    ],
)
def test_bad_columns_are_refused(columns: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(DataError, match=message):
        Recording.from_columns("a", columns)
