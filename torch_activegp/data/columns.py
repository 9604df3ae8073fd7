"""The column map: how the columns of a user's file become canonical columns in SI units.

A TOML file with one line for each canonical column. The value is the file's own name of the column, or a table::

    time       = { column = "t", unit = "ms" }
    run        = "trial"                        # rows with equal values belong to one run
    qpos.elbow = { column = "enc1", unit = "counts", counts_per_turn = 4096, sign = -1 }
    qpos.slide = { column = "x", unit = "mm", offset = 0.12 }
    qvel.elbow = { column = "speed", unit = "rpm" }
    ctrl.motor = "duty"
    qfrc.slide = { scale = 9.81 }               # the file calls it `qfrc.slide` itself, in kgf
    qpos."arm/elbow" = "q2"                     # quotes around a name with other characters than A-Z, a-z, 0-9, - and _
    prescribed = ["slide"]                      # joints that something else moved or held along the recorded positions
    video      = true                           # positions from a video, whose errors last

==================  ================================================================================================
``column``          name in the file; without it, the canonical name
``unit``            time: s, ms, us, ns, min. qpos: rad, mrad, deg, turn, m, cm, mm, um, counts. qvel: the same per
                    second ("deg/s"), and rpm. qfrc: N, kN, mN, "N m", "mN m". ctrl: any of these, V, mV, A, mA, 1, %
``counts_per_turn``  encoder steps in one turn, with the unit counts or "counts/s"
``sign``            1 or -1
``scale``           a further factor, for anything that has no unit here
``offset``          added last, in SI units
``rows_late``       of controls and forces: by how many rows the file has them too late; 1 where a row holds the command
                    that led to its position. They are moved up by so many; the last one is held
``hold_order``      of controls and forces: 0, the default, where a value holds from its row until the next (zero-order
                    hold); 1 where it changes evenly to the next row's (first-order hold); 3 where the rows hold samples
                    of a smooth command, along a cubic spline. Then its mean from row to row is held, which moves the
                    machine as far to second order. Behind `rows_late`, where both are given
==================  ================================================================================================

The value is ``sign * scale * unit * raw + offset``. Columns of the file that already have canonical names are taken as
they are, all others are left out, and the recording's notes say which. A header ``[columns]`` above the lines is
optional.
"""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from torch_activegp.data.checks import KINDS, check_finite, is_canonical
from torch_activegp.data.column_rules import ColumnRule, read_rule
from torch_activegp.data.spline_means import spline_means
from torch_activegp.errors import DataError

_COMMA = re.compile(r"[+-]?\d+,\d+")


class ColumnMap:
    """Renames, rescales and flips the columns of a table.

    Args:
        rules: rule by canonical name (``time``, ``run``, ``qpos.<joint>``, ...).
        name: what messages call the map, usually the file's name.
        prescribed: joints that something else moved or held along the recorded positions.
        video: whether the positions come from a video.

    >>> columns = ColumnMap.from_mapping({"time": {"column": "t", "unit": "ms"}, "qpos": {"elbow": "q"}})
    >>> columns.apply(pd.DataFrame({"t": [0, 10], "q": [0.5, 0.6]}), "a.csv").columns.tolist()
    ['time', 'qpos.elbow']
    """

    def __init__(
        self,
        rules: Mapping[str, ColumnRule] | None = None,
        name: str = "column map",
        prescribed: Sequence[str] = (),
        video: bool = False,
    ) -> None:
        self.rules = dict(rules or {})
        self.name = name
        self.prescribed = tuple(prescribed)
        self.video = video

    @classmethod
    def from_toml(cls, path: str | Path) -> ColumnMap:
        """Read a map from a TOML file.

        Raises:
            DataError: if there is no such file, it is not TOML, or a line of it cannot be used.
        """
        path = Path(path)
        if not path.is_file():
            raise DataError(f"{path}: no such file. Give the path of a TOML column map.")
        try:
            mapping = tomllib.loads(path.read_text(encoding="utf-8"))
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise DataError(f"{path.name}: not a TOML file: {error}.") from error
        return cls.from_mapping(mapping, path.name)

    @classmethod
    def from_mapping(cls, mapping: Mapping[str, Any], name: str = "column map") -> ColumnMap:
        """Build a map from what TOML holds: nested by kind, or with ``"qpos.elbow"`` as one key.

        Raises:
            DataError: if a name is not canonical, or a setting is unknown, of a wrong type or contradicts another.
        """
        flat = _below_its_header(mapping, name)
        prescribed, video = _joints(flat.pop("prescribed", []), name), flat.pop("video", False)
        if not isinstance(video, bool):
            raise DataError(f"{name}: `video` wants true or false, found {video!r}.")
        for key in flat:
            if not is_canonical(key):
                raise DataError(
                    f"{name}: `{key}` is not a canonical column: `time`, `run` or `<kind>.<name>` wanted, kind one of "
                    f"{', '.join(KINDS)}. The canonical name stands on the left, the file's own name on the right."
                )
        return cls({key: read_rule(key, value, name) for key, value in flat.items()}, name, prescribed, video)

    def apply(self, table: pd.DataFrame, where: str) -> pd.DataFrame:
        """Return the canonical columns of a raw table, in SI units, as float64 (``run`` as text).

        Args:
            table: raw columns by the file's names.
            where: the file's name for the messages.

        Raises:
            DataError: if a column that the map names is missing, a column has no canonical name and there is no map, or
                a cell is not a finite number; the message names file, column and row.
        """
        taken = {rule.column for rule in self.rules.values()}
        own = {
            str(name): ColumnRule(str(name)) for name in table.columns if is_canonical(str(name)) and name not in taken
        }
        rules = own | self.rules
        if not self.rules and not self.prescribed and not self.video:
            _refuse_unknown(table, where)
        found = pd.DataFrame({key: self._column(table, key, rule, where) for key, rule in rules.items()})
        runs = found["run"] if "run" in found else np.zeros(len(found))
        for key, rule in rules.items():
            if rule.rows_late:
                found[key] = _earlier(found[key], runs, rule, where)
            if rule.hold_order:
                found[key] = _means(found[key], found["time"] if "time" in found else None, runs, rule.hold_order)
        return found

    def unused(self, table: pd.DataFrame) -> list[str]:
        """Return the raw columns that this map leaves out."""
        taken = {rule.column for rule in self.rules.values()}
        return [str(name) for name in table.columns if name not in taken and not is_canonical(str(name))]

    def notes(self, table: pd.DataFrame) -> list[str]:
        """What to know of how it reads a raw table: which columns are left out, and which are not held."""
        unused = self.unused(table)
        moving = [f"{key} (hold_order = {rule.hold_order})" for key, rule in self.rules.items() if rule.hold_order]
        out = [f"Columns left out: {', '.join(unused)}."] if unused else []
        return out + ([f"Taken to change from row to row: {', '.join(moving)}."] if moving else [])

    def _column(self, table: pd.DataFrame, key: str, rule: ColumnRule, where: str) -> Any:
        if rule.column not in table.columns:
            raise DataError(
                f"{where}: no column `{rule.column}`, which {self.name} gives for `{key}`{_hint(rule.column, table)}; "
                f"found {', '.join(map(str, table.columns))}."
            )
        series = table[rule.column]
        if key == "run":
            return _run_names(series, where)
        return rule.factor * _floats(series, where, rule.column) + rule.offset


def _earlier(values: pd.Series, runs: Any, rule: ColumnRule, where: str) -> pd.Series:
    """A column moved up by the rows that it is late by, of which each run has more."""
    shortest = int(values.groupby(runs, sort=False).size().min())
    if shortest <= rule.rows_late:
        raise DataError(
            f"{where}, column `{rule.column}`: more than {rule.rows_late} rows wanted in each run, for `rows_late`; "
            f"found {shortest}."
        )
    return _moved_up(values, runs, rule.rows_late)


def _means(values: pd.Series, time: pd.Series | None, runs: Any, order: int) -> pd.Series:
    """Means from each row to the next of splines through a column, within each run; the last value is held.

    Where a run has no more rows than the order, or no clock that goes on, of straight lines between rows.
    """
    means = 0.5 * (values + _moved_up(values, runs, 1))
    if order == 1 or time is None:
        return means
    for _, own in values.groupby(runs, sort=False):
        clock = time[own.index].to_numpy()
        if len(own) > order and (np.diff(clock) > 0.0).all():
            means[own.index[:-1]] = spline_means(clock, own.to_numpy(), clock, order)
    return means


def _moved_up(values: pd.Series, runs: Any, rows: int) -> pd.Series:
    """A column moved up by some rows within each run; the last value is held."""
    moved = values.groupby(runs, sort=False).shift(-rows)
    return moved.groupby(runs, sort=False).ffill().fillna(values)


def _below_its_header(mapping: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The lines of a map, by their whole names, some or all of which stand below ``[columns]``."""
    lines = mapping.get("columns", {})
    if not isinstance(lines, Mapping):
        raise DataError(f"{name}: `columns` wants the lines of the map as a table, found {lines!r}.")
    above, below = _flat({key: value for key, value in mapping.items() if key != "columns"}), _flat(lines)
    if twice := sorted(above.keys() & below.keys()):
        raise DataError(f"{name}: `{twice[0]}` stands above `[columns]` and below it. Keep one of the two.")
    return above | below


def _flat(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """Lines by ``qpos.elbow`` and the like, however they are nested."""
    flat: dict[str, Any] = {}
    for key, value in mapping.items():
        inside = key in KINDS and isinstance(value, Mapping)
        flat |= {f"{key}.{joint}": entry for joint, entry in value.items()} if inside else {key: value}
    return flat


def _joints(value: object, name: str) -> list[str]:
    if not isinstance(value, list | tuple) or not all(isinstance(joint, str) for joint in value):
        raise DataError(f'{name}: `prescribed` wants names of joints, such as ["turntable"], found {value!r}.')
    return list(value)


def _refuse_unknown(table: pd.DataFrame, where: str) -> None:
    for name in map(str, table.columns):
        if not is_canonical(name):
            raise DataError(
                f"{where}: unknown column `{name}`. Columns are `time` [s], `qpos.<joint>`, `qvel.<joint>`, "
                "`ctrl.<actuator>`, `qfrc.<joint>` and `run`; rename it, or name the columns that you need in a column "
                "map (--columns MAP.toml): with one, columns of other names are left out."
            )


def _floats(series: pd.Series, where: str, column: str) -> np.ndarray:
    if pd.api.types.is_datetime64_any_dtype(series):
        raise DataError(f"{where}, column `{column}`: seconds wanted, found time stamps. Subtract the first one.")
    numbers = pd.to_numeric(series, errors="coerce")
    text = np.flatnonzero((numbers.isna() & series.notna()).to_numpy() & (series.astype(str).str.lower() != "nan"))
    if text.size:
        cell = series.iloc[text[0]]
        mend = (
            "Write points, or commas everywhere and semicolons between columns."
            if _COMMA.fullmatch(str(cell))
            else "Mend the cell or drop the row."
        )
        raise DataError(f"{where}, row {text[0] + 1}, column `{column}`: a number wanted, found {cell!r}. {mend}")
    values = numbers.to_numpy(dtype=np.float64, na_value=np.nan)
    check_finite(values, where, column)
    return values


def _run_names(series: pd.Series, where: str) -> np.ndarray:
    if series.isna().any():
        row = int(np.flatnonzero(series.isna())[0]) + 1
        raise DataError(f"{where}, row {row}, column `{series.name}`: the run's name is missing. Fill it in.")
    whole = pd.api.types.is_float_dtype(series) and bool((series % 1 == 0).all())
    return (series.astype("int64") if whole else series).astype(str).to_numpy(dtype=object)


def _hint(column: str, table: pd.DataFrame) -> str:
    near = difflib.get_close_matches(column, [str(name) for name in table.columns], n=1)
    return f" (did you mean `{near[0]}`?)" if near else ""
