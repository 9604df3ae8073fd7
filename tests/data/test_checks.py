from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.data.checks import check_columns, check_finite, is_canonical
from torch_activegp.errors import DataError

TIME = np.arange(200) * 0.01


def columns(**changes: np.ndarray) -> dict[str, np.ndarray]:
    good = {"time": TIME, "qpos.elbow": np.sin(3 * TIME), "qvel.elbow": 3 * np.cos(3 * TIME), "ctrl.motor": 0 * TIME}
    return good | {name.replace("_", "."): values for name, values in changes.items()}


def changed(values: np.ndarray, row: int, value: float) -> np.ndarray:
    values = values.copy()
    values[row - 1] = value
    return values


@pytest.mark.parametrize("name", ["time", "run", "qpos.a", "qvel.a.b", "ctrl.left/motor", "qfrc.a"])
def test_canonical_names(name: str) -> None:
    assert is_canonical(name)


@pytest.mark.parametrize("name", ["Time", "qpos", "qpos.", ".a", "torque.a", "qpos_a", ""])
def test_other_names(name: str) -> None:
    assert not is_canonical(name)


def test_good_columns_pass() -> None:
    check_columns(columns(), "run.csv")


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"qpos.elbow": TIME}, "run.csv: no column `time`, found qpos.elbow"),
        ({}, "no column `time`, found none"),
        (columns() | {"angle": TIME}, "unknown column `angle`"),
        ({"time": TIME, "ctrl.motor": TIME}, "no position, found time, ctrl.motor"),
        (columns(qpos_elbow=TIME[:9]), "columns differ in length"),
        ({"time": TIME[:3], "qpos.a": TIME[:3]}, "too short, 3 rows found, at least 4 wanted"),
        (
            columns(ctrl_motor=changed(TIME, 7, np.nan)),
            "run.csv, row 7, column `ctrl.motor`: .* found nan .or an empty cell.. Fill",
        ),
        (columns(qpos_elbow=changed(TIME, 200, -np.inf)), "row 200, column `qpos.elbow`: .* found -inf"),
        (
            columns(time=changed(TIME, 50, 0.4)),
            r"row 50: `time` goes back from 0.48 s to 0.4 s. Split the file there if",
        ),
        (
            columns(time=changed(TIME, 50, TIME[48])),
            r"row 50: `time` stands still at 0.48 s.*else drop the doubled row",
        ),
    ],
)
def test_a_bad_table_is_refused_with_its_place(bad: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(DataError, match=message):
        check_columns(bad, "run.csv")


def test_the_rows_of_the_file_are_named() -> None:
    with pytest.raises(DataError, match=r"row 107, .*\(2 such rows\)"):
        check_finite(np.array([0, np.nan, np.nan]), "run.csv", "qpos.a", rows=np.array([105, 107, 109]))
    with pytest.raises(DataError, match="row 1050: `time`"):
        check_columns(columns(time=changed(TIME, 50, 0.4)), "run.csv", rows=np.arange(200) + 1001)


@pytest.mark.parametrize(
    ("position", "velocity", "clock", "guess"),
    [
        (180 / np.pi, 1, 1, "the position looks like deg\\. "),
        (1, 180 / np.pi, 1, "the velocity looks like deg/s"),
        (1, 30 / np.pi, 1, "the velocity looks like rpm"),
        (180 / np.pi, 30 / np.pi, 1, "the position looks like deg and the velocity like rpm"),
        (1 / (2 * np.pi), 1, 1, "the position looks like turns"),
        (1, 1 / (2 * np.pi), 1, "the velocity looks like turn/s"),
        (1e3, 1, 1, "the position looks like mm"),
        (1, 1, 1e3, "the time looks like ms"),
        (-1, 1, 1, "wrong sign"),
        (12, 1, 1, "check the units of both"),
    ],
)
def test_a_wrong_unit_is_noticed_by_the_velocity(position: float, velocity: float, clock: float, guess: str) -> None:
    noise = np.random.default_rng(0).normal(0, 0.01, len(TIME))
    bad = columns(
        time=clock * TIME, qpos_elbow=position * np.sin(3 * TIME), qvel_elbow=velocity * (3 * np.cos(3 * TIME) + noise)
    )
    with pytest.raises(DataError, match=f"run.csv, column `qvel.elbow`: .*{guess}"):
        check_columns(bad, "run.csv")


@pytest.mark.parametrize(
    ("position", "velocity"),
    [
        (np.sin(3 * TIME), np.random.default_rng(0).normal(size=200)),  # a velocity of noise says nothing about units
        (np.sin(3 * TIME), 0 * TIME),
        (0 * TIME, np.cos(3 * TIME)),
        (np.remainder(20 * TIME, 2 * np.pi), 0 * TIME + 20),  # leaps of a turn
        (np.round(np.sin(3 * TIME), 2), 3 * np.cos(3 * TIME)),  # a coarse encoder
        (np.sin(3 * TIME), 3 * np.cos(3 * (TIME - 0.03))),  # a late velocity
    ],
)
def test_units_are_not_doubted_without_evidence(position: np.ndarray, velocity: np.ndarray) -> None:
    check_columns(columns(qpos_elbow=position, qvel_elbow=velocity), "run.csv")


def test_a_few_rows_say_nothing_of_units() -> None:
    few = {"time": TIME[:11], "qpos.elbow": -np.sin(3 * TIME[:11]), "qvel.elbow": 3 * np.cos(3 * TIME[:11])}
    check_columns(few, "run.csv")
    with pytest.raises(DataError, match="wrong sign"):
        check_columns(
            {"time": TIME[:12], "qpos.elbow": -np.sin(3 * TIME[:12]), "qvel.elbow": 3 * np.cos(3 * TIME[:12])},
            "run.csv",
        )
