from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from torch_activegp.data.column_rules import ColumnRule
from torch_activegp.data.columns import ColumnMap
from torch_activegp.errors import DataError

TOML = """
time       = { column = "t", unit = "ms" }
run        = "trial"
qpos.elbow = { column = "enc1", unit = "counts", counts_per_turn = 4096, sign = -1, offset = 0.5 }
qvel.elbow = { column = "speed", unit = "rpm" }
ctrl.motor = "duty"
qfrc.slide = { scale = 9.81 }
qpos."arm/x.y" = { column = "x", unit = "mm" }
"""


def table() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "t": [0, 10, 20],
            "trial": ["a", "a", "b"],
            "enc1": [0, 1024, 4096],
            "speed": [60.0, 0.0, -30.0],
            "duty": [0.1, 0.2, 0.3],
            "qfrc.slide": [1, 2, 3],
            "x": [1, 2, 3],
            "temperature": [20, 21, 22],
            "qvel.knee": [0.0, 1.0, 2.0],
        }
    )


def test_a_map_renames_rescales_and_flips(tmp_path: Path) -> None:
    path = tmp_path / "map.toml"
    path.write_text(TOML, encoding="utf-8")
    columns = ColumnMap.from_toml(path)
    out = columns.apply(table(), "run.csv")
    expected = {
        "time": [0, 0.01, 0.02],
        "qpos.elbow": [0.5, 0.5 - math.pi / 2, 0.5 - 2 * math.pi],
        "qvel.elbow": [2 * math.pi, 0, -math.pi],
        "ctrl.motor": [0.1, 0.2, 0.3],
        "qfrc.slide": [9.81, 19.62, 29.43],
        "qpos.arm/x.y": [0.001, 0.002, 0.003],
        "qvel.knee": [0, 1, 2],
    }
    assert set(out.columns) == {*expected, "run"}
    for name, values in expected.items():
        np.testing.assert_allclose(out[name], values, atol=1e-15)
        assert out[name].dtype == np.float64
    assert out["run"].tolist() == ["a", "a", "b"]
    assert columns.unused(table()) == ["temperature"]


def test_a_command_that_was_logged_after_it_acted_moves_up_within_its_run() -> None:
    raw = pd.DataFrame({"time": np.arange(6.0), "run": list("aaabbb"), "u": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]})
    late = {"column": "u", "rows_late": 1}
    found = ColumnMap.from_mapping({"ctrl": {"motor": late}}).apply(raw, "a.csv")
    assert found["ctrl.motor"].tolist() == [2.0, 3.0, 3.0, 5.0, 6.0, 6.0]
    far = ColumnMap.from_mapping({"ctrl": {"motor": late | {"rows_late": 3}}})
    with pytest.raises(DataError, match="a.csv, column `u`: more than 3 rows wanted in each run, .* found 3"):
        far.apply(raw, "a.csv")
    alone = ColumnMap.from_mapping({"ctrl": {"motor": late}}).apply(raw.drop(columns="run"), "a.csv")
    assert alone["ctrl.motor"].tolist() == [2.0, 3.0, 4.0, 5.0, 6.0, 6.0]


def test_a_command_that_changes_evenly_holds_its_mean_to_the_next_row_of_its_run() -> None:
    raw = pd.DataFrame({"time": np.arange(6.0), "run": list("aaabbc"), "u": [1.0, 2.0, 4.0, 5.0, 9.0, 6.0]})
    for late, means in ((0, [1.5, 3.0, 4.0, 7.0, 9.0, 6.0]), (1, None)):
        rule = {"column": "u", "hold_order": 1, "rows_late": late}
        columns = ColumnMap.from_mapping({"ctrl": {"motor": rule}, "qfrc": {"slide": {"column": "u"}}})
        found = columns.apply(raw if means else raw[:3], "a.csv")
        assert found["ctrl.motor"].tolist() == (means or [3.0, 4.0, 4.0])
        assert found["qfrc.slide"].tolist() == raw["u"].tolist()[: len(found)]


def test_a_smooth_command_holds_the_means_of_a_spline_within_its_run() -> None:
    time = np.arange(40) * 0.05
    raw = pd.DataFrame({"time": np.tile(time, 2), "run": ["a"] * 40 + ["b"] * 40, "u": np.sin(np.tile(time, 2) * 4)})
    raw.loc[40:, "u"] += 7.0
    found = ColumnMap.from_mapping({"ctrl": {"motor": {"column": "u", "hold_order": 3}}}).apply(raw, "a.csv")
    means = (np.cos(4 * time[:-1]) - np.cos(4 * time[1:])) / (4 * 0.05)
    for first, more in ((0, 0.0), (40, 7.0)):
        own = found["ctrl.motor"].to_numpy()[first : first + 40] - more
        np.testing.assert_allclose(own[:-1], means, atol=3e-4)
        assert own[-1] == pytest.approx(raw["u"][39])
    few = ColumnMap.from_mapping({"ctrl": {"motor": {"column": "u", "hold_order": 3}}}).apply(raw[:3], "a.csv")
    np.testing.assert_allclose(few["ctrl.motor"][:2], 0.5 * (raw["u"][:2] + raw["u"][1:3].to_numpy()))


def test_a_map_says_which_joints_are_prescribed() -> None:
    """Such a map is one: it leaves columns out."""
    columns = ColumnMap.from_mapping({"prescribed": ["slide"]})
    assert (columns.prescribed, columns.rules) == (("slide",), {})
    assert list(columns.apply(table(), "run.csv")) == ["qfrc.slide", "qvel.knee"]
    assert ColumnMap.from_mapping({"qpos.a": "x"}).prescribed == ColumnMap().prescribed == ()


def test_a_map_says_that_positions_come_from_a_video() -> None:
    columns = ColumnMap.from_mapping({"video": True})
    assert (columns.video, columns.rules) == (True, {})
    assert not ColumnMap.from_mapping({"qpos.a": "x"}).video


def test_the_flat_and_the_nested_form_are_one() -> None:
    nested = ColumnMap.from_mapping({"qpos": {"a": {"unit": "deg"}}, "ctrl": {"m": "u"}})
    flat = ColumnMap.from_mapping({"qpos.a": {"unit": "deg"}, "ctrl.m": "u"})
    below = ColumnMap.from_mapping({"video": True, "columns": {"qpos.a": {"unit": "deg"}, "ctrl": {"m": "u"}}})
    assert below.video
    assert below.rules == flat.rules
    parted = ColumnMap.from_mapping({"qpos": {"a": {"unit": "deg"}}, "columns": {"ctrl": {"m": "u"}}})
    assert parted.rules == flat.rules
    assert nested.rules == flat.rules == {"qpos.a": ColumnRule("qpos.a", math.pi / 180), "ctrl.m": ColumnRule("u")}


def test_a_column_that_the_map_takes_is_not_taken_twice() -> None:
    raw = pd.DataFrame({"qpos.a": [1.0, 2.0], "qpos.b": [3.0, 4.0]})
    out = ColumnMap.from_mapping({"qpos.b": "qpos.a", "qpos.a": "qpos.b"}).apply(raw, "run.csv")
    assert out["qpos.b"].tolist() == [1, 2]
    assert out["qpos.a"].tolist() == [3, 4]
    assert list(ColumnMap.from_mapping({"qpos.c": "qpos.a"}).apply(raw, "run.csv")) == ["qpos.b", "qpos.c"]


@pytest.mark.parametrize(
    ("run", "names"),
    [([1.0, 1.0, 2.0], ["1", "1", "2"]), ([0.5, 1, 2], ["0.5", "1.0", "2.0"]), ([3, 3, 4], ["3", "3", "4"])],
)
def test_numbers_name_runs(run: list, names: list[str]) -> None:
    out = ColumnMap().apply(pd.DataFrame({"run": run, "time": [0, 1, 2]}), "run.csv")
    assert out["run"].tolist() == names


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"position.a": "x"}, "map.toml: `position.a` is not a canonical column"),
        ({"enc1": "qpos.a"}, "The canonical name stands on the left"),
        ({"qpos": "x"}, "`qpos` is not a canonical column"),
        ({"columns": "x"}, "`columns` wants the lines of the map as a table, found 'x'"),
        ({"qpos.a": "x", "columns": {"qpos": {"a": "y"}}}, r"`qpos.a` stands above `\[columns\]` and below it"),
        (
            {"prescribed": "arm"},
            r'map.toml: `prescribed` wants names of joints, such as \["turntable"\], found \'arm\'',
        ),
        ({"prescribed": [1]}, "`prescribed` wants names of joints"),
        ({"video": "yes"}, "map.toml: `video` wants true or false, found 'yes'"),
    ],
)
def test_a_bad_map_is_refused(mapping: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        ColumnMap.from_mapping(mapping, "map.toml")


def test_a_file_that_is_no_map_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        ColumnMap.from_toml(tmp_path / "none.toml")
    path = tmp_path / "map.toml"
    path.write_text("time = ", encoding="utf-8")
    with pytest.raises(DataError, match="map.toml: not a TOML file"):
        ColumnMap.from_toml(path)


@pytest.mark.parametrize(
    ("mapping", "raw", "message"),
    [
        ({}, {"time": [0], "angle": [1]}, "run.csv: unknown column `angle`"),
        ({"qpos.a": "angel"}, {"time": [0], "angle": [1]}, r"no column `angel`, .*did you mean `angle`\?"),
        ({"time": "t"}, {"x": [0]}, "no column `t`, which map.toml gives for `time`; found x"),
        ({"qpos.a": "x"}, {"x": [1.0, np.nan, 2.0]}, "run.csv, row 2, column `x`: a finite number wanted, found nan"),
        (
            {"qpos.a": "x"},
            {"x": ["1", "2", "3,5"]},
            "row 3, column `x`: .* found '3,5'. Write points, or commas everywhere",
        ),
        ({"qpos.a": "x"}, {"x": [1.0, -np.inf]}, "row 2, column `x`: .* found -inf"),
        ({"run": "x"}, {"x": ["a", None]}, "row 2, column `x`: the run's name is missing"),
        (
            {"time": "x"},
            {"x": pd.to_datetime(["2024-01-01", "2024-01-02"])},
            "run.csv, column `x`: seconds wanted, found time stamps",
        ),
    ],
)
def test_a_table_that_does_not_fit_the_map_is_refused(mapping: dict, raw: dict, message: str) -> None:
    with pytest.raises(DataError, match=message):
        ColumnMap.from_mapping(mapping, "map.toml").apply(pd.DataFrame(raw), "run.csv")
