from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

from torch_activegp.data.columns import ColumnMap
from torch_activegp.data.loading import load_recordings
from torch_activegp.data.recording import Recording
from torch_activegp.errors import DataError

TIME = np.arange(40) * 0.01


def write(path: Path, **columns: object) -> Path:
    names = {name.replace("_", "."): values for name, values in columns.items()}
    pd.DataFrame(names).to_csv(path, index=False)
    return path


def test_one_run(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", time=TIME, qpos_x=TIME**2, ctrl_u=np.cos(TIME))
    (recording,) = load_recordings(path)
    assert str(recording) == "a.csv: 40 rows, 0.39 s at 100 Hz; joints x; actuators u; no velocities"
    assert recording.source == path
    assert recording.notes == ()
    np.testing.assert_array_equal(recording["ctrl.u"], np.cos(TIME))


def test_a_recording_survives_a_memmap_folder(tmp_path: Path) -> None:
    columns = {"time": TIME, "qpos.arm/x.y": np.sin(TIME), "qvel.arm/x.y": np.cos(TIME), "ctrl.u": TIME}
    recording = Recording.from_columns("a", columns)
    recording.data.memmap(tmp_path / "saved")
    (again,) = load_recordings(tmp_path / "saved")
    assert again.columns == recording.columns
    assert all(torch.equal(again[name], recording[name]) for name in again.columns)


@pytest.mark.parametrize("form", ["list", "pattern", "string"])
def test_several_files(tmp_path: Path, form: str) -> None:
    paths = [write(tmp_path / f"run{number}.csv", time=TIME, qpos_x=TIME + number) for number in range(3)]
    given = {"list": paths, "pattern": str(tmp_path / "run*.csv"), "string": [str(path) for path in paths]}[form]
    assert [recording.source for recording in load_recordings(given)] == paths


def test_the_run_column_splits_and_each_run_has_its_own_clock(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", time=np.tile(TIME, 2), qpos_x=np.tile(TIME, 2), run=["b"] * 40 + ["a"] * 40)
    runs = load_recordings(path)
    assert [(recording.run, len(recording)) for recording in runs] == [("b", 40), ("a", 40)]
    assert [recording.label for recording in runs] == ["a.csv (run b)", "a.csv (run a)"]


def test_rows_of_runs_may_be_mixed(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", time=np.repeat(TIME, 2), qpos_x=np.tile([1.0, 2.0], 40), run=[0, 1] * 40)
    first, second = load_recordings(path)
    assert set(first["qpos.x"].tolist()) == {1.0}
    assert set(second["qpos.x"].tolist()) == {2.0}


def test_a_gap_splits_and_is_told(tmp_path: Path) -> None:
    time = np.delete(TIME, np.r_[10:16, 30])  # the step over one lost row is no gap
    first, second = load_recordings(write(tmp_path / "a.csv", time=time, qpos_x=time))
    assert (first.run, second.run) == ("1", "2")
    assert torch.cat([first.time, second.time]).tolist() == pytest.approx(time.tolist())
    assert len(first) == 10
    assert first.notes == second.notes == ("Gap of 0.07 s after row 10: the run is split there.",)


def test_a_gap_within_a_named_run_and_a_part_that_is_too_short(tmp_path: Path) -> None:
    time = np.delete(TIME, np.r_[2:10, 20:30])
    path = write(tmp_path / "a.csv", time=time, qpos_x=time, run=["left"] * len(time))
    first, second = load_recordings(path)
    assert (first.run, second.run) == ("left.1", "left.2")
    assert len(first) == len(second) == 10
    assert first.notes[2] == "Rows 1 to 2 left out: a part of 2 rows is too short."


def test_the_map_may_be_a_file_a_mapping_or_a_map(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", t=1000 * TIME, x=TIME, extra=TIME)
    mapping = {"time": {"column": "t", "unit": "ms"}, "qpos": {"slide": "x"}}
    toml = tmp_path / "map.toml"
    toml.write_text('time = {column = "t", unit = "ms"}\nqpos.slide = "x"\n', encoding="utf-8")
    for columns in (toml, str(toml), mapping, ColumnMap.from_mapping(mapping)):
        (recording,) = load_recordings(path, columns)
        assert recording.dt == pytest.approx(0.01)
        assert recording.notes == ("Columns left out: extra.",)


def test_the_map_says_what_is_prescribed_in_every_part_of_a_run(tmp_path: Path) -> None:
    time = np.delete(TIME, np.r_[10:16])
    path = write(tmp_path / "a.csv", time=time, qpos_x=time, qpos_y=time)
    toml = tmp_path / "map.toml"
    toml.write_text('prescribed = ["y"]\n', encoding="utf-8")
    assert [recording.prescribed for recording in load_recordings(path, toml)] == [("y",), ("y",)]
    toml.write_text("video = true\n", encoding="utf-8")
    assert [recording.video for recording in load_recordings(path, toml)] == [True, True]
    toml.write_text('prescribed = ["z"]\n', encoding="utf-8")
    with pytest.raises(DataError, match="a.csv \\(run 1\\): no column `qpos.z`, and `z` is said to be prescribed"):
        load_recordings(path, toml)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"qpos_x": TIME}, "a.csv: no column `time`"),
        ({"time": TIME, "angle": TIME}, "a.csv: unknown column `angle`"),
        ({"time": TIME[:3], "qpos_x": TIME[:3]}, "a.csv: too short, 3 rows"),
        ({"time": np.r_[TIME[:20], TIME[:20]], "qpos_x": TIME}, "a.csv, row 21: `time` goes back from 0.19 s to 0 s"),
        ({"time": TIME, "qpos_x": np.where(TIME == 0.05, np.nan, 1)}, "a.csv, row 6, column `qpos.x`"),
        ({"time": np.r_[0, 1, 2, 30, 31, 32], "qpos_x": TIME[:6]}, "a.csv: too short, no 4 rows without a gap"),
        (
            {"time": np.r_[TIME, TIME[::-1]], "qpos_x": np.tile(TIME, 2), "run": [0] * 40 + [1] * 40},
            r"a.csv \(run 1\), row 42: `time` goes back",
        ),
        (
            {"time": TIME, "qpos_x": 57.3 * np.sin(TIME), "qvel_x": np.cos(TIME)},
            "a.csv, column `qvel.x`: .*the position looks like deg",
        ),
    ],
)
def test_bad_input_names_file_column_and_row(tmp_path: Path, columns: dict, message: str) -> None:
    path = write(tmp_path / "a.csv", **columns)
    with pytest.raises(DataError, match=message):
        load_recordings(path)


def test_no_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"run\*.csv: no file matches the pattern"):
        load_recordings(str(tmp_path / "run*.csv"))
    with pytest.raises(DataError, match="none.csv: no such file"):
        load_recordings(tmp_path / "none.csv")
    with pytest.raises(DataError, match="no recording given"):
        load_recordings([])
