"""Checks on recorded columns: one message that names the file, the column and the row."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from torch_activegp.errors import DataError

KINDS = ("qpos", "qvel", "ctrl", "qfrc")
"""What a column ``<kind>.<name>`` holds: position, velocity, control, known external force."""

MIN_ROWS = 4
_TELLING = 12
"""Fewer rows say nothing of units and signs: noise alone may turn three steps around."""
_UNIT_SLIPS = {
    180 / np.pi: "the position looks like deg",
    np.pi / 180: "the velocity looks like deg/s",
    np.pi / 30: "the velocity looks like rpm",
    6.0: "the position looks like deg and the velocity like rpm",
    1 / (2 * np.pi): "the position looks like turns",
    2 * np.pi: "the velocity looks like turn/s",
    1e3: "the position looks like mm",
    1e-3: "the time looks like ms, or the velocity like mm/s",
}


def is_canonical(column: str) -> bool:
    """Return whether a column name is ``time``, ``run`` or ``<kind>.<name>`` with a known kind."""
    kind, dot, name = column.partition(".")
    return column in ("time", "run") or (kind in KINDS and bool(dot) and bool(name))


def check_columns(columns: Mapping[str, np.ndarray], where: str, rows: np.ndarray | None = None) -> None:
    """Refuse columns that are no recording.

    Args:
        columns: arrays ``(T,)`` by canonical name, SI units.
        where: file name for the messages.
        rows: integers ``(T,)``, the row of the file that each entry came from (1-based, header not counted).

    Raises:
        DataError: if ``time`` or every position is missing, a name is unknown, lengths differ, fewer than 4 rows are
            left, a value is not finite, time does not increase, or a velocity contradicts its position by a unit.
    """
    _check_names(columns, where)
    lengths = {name: len(values) for name, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DataError(f"{where}: columns differ in length ({lengths}). Give every column one value a row.")
    if lengths["time"] < MIN_ROWS:
        raise DataError(f"{where}: too short, {lengths['time']} rows found, at least {MIN_ROWS} wanted. Record longer.")
    rows = np.arange(1, lengths["time"] + 1) if rows is None else rows
    for name, values in columns.items():
        check_finite(values, where, name, rows)
    _check_time(columns["time"], where, rows)
    for name in columns:
        if name.startswith("qvel.") and f"qpos.{name[5:]}" in columns:
            _check_velocity(columns["time"], columns[f"qpos.{name[5:]}"], columns[name], f"{where}, column `{name}`")


def check_finite(values: np.ndarray, where: str, column: str, rows: np.ndarray | None = None) -> None:
    """Refuse NaN and infinity.

    Raises:
        DataError: naming the first row that is not a finite number.
    """
    bad = np.flatnonzero(~np.isfinite(values))
    if bad.size:
        row = bad[0] + 1 if rows is None else rows[bad[0]]
        more = " (or an empty cell)" if np.isnan(values[bad[0]]) else ""
        more += f" ({bad.size} such rows)" if bad.size > 1 else ""
        raise DataError(
            f"{where}, row {row}, column `{column}`: a finite number wanted, found {values[bad[0]]}{more}. "
            "Fill the value in or drop the row."
        )


def _check_names(columns: Mapping[str, np.ndarray], where: str) -> None:
    if "time" not in columns:
        raise DataError(
            f"{where}: no column `time`, found {', '.join(columns) or 'none'}. "
            "Rename the clock to `time` [s], or map it with a column map (--columns MAP.toml)."
        )
    for name in columns:
        if name == "run" or not is_canonical(name):
            raise DataError(
                f"{where}: unknown column `{name}`. Columns are `time` or `<kind>.<name>`, kind in {KINDS}."
            )
    if not any(name.startswith("qpos.") for name in columns):
        raise DataError(
            f"{where}: no position, found {', '.join(columns)}. At least one column `qpos.<joint>` is needed; "
            "rename it or map it with a column map (--columns MAP.toml)."
        )


def _check_time(time: np.ndarray, where: str, rows: np.ndarray) -> None:
    bad = np.flatnonzero(np.diff(time) <= 0)
    if bad.size:
        before, after = time[bad[0]], time[bad[0] + 1]
        found = f"goes back from {before:.10g} s to" if after < before else "stands still at"
        mend = "sort the rows" if after < before else "drop the doubled row"
        raise DataError(
            f"{where}, row {rows[bad[0] + 1]}: `time` {found} {after:.10g} s. "
            f"Split the file there if another recording begins, else {mend}; "
            "or give a column map (--columns MAP.toml) with a `run` column."
        )


def _check_velocity(time: np.ndarray, position: np.ndarray, velocity: np.ndarray, where: str) -> None:
    """Compare position steps with the velocity where it is large; a steady ratio far from 1 is a unit or a sign."""
    if len(time) < _TELLING:
        return
    step = (velocity[1:] + velocity[:-1]) / 2 * np.diff(time)
    fast = (np.abs(step) >= np.quantile(np.abs(step), 0.75)) & (step != 0)
    if not fast.any():
        return
    low, ratio, high = np.quantile(np.diff(position)[fast] / step[fast], [0.25, 0.5, 0.75])
    if 0.5 < ratio < 2 or ratio == 0 or high - low > 0.3 * abs(ratio):
        return
    slip = min(_UNIT_SLIPS, key=lambda slip: abs(np.log(abs(ratio) / slip)))
    guess = _UNIT_SLIPS[slip] if 0.8 < abs(ratio) / slip < 1.25 else "check the units of both"
    guess = "one of the two has the wrong sign" if -2 < ratio < -0.5 else guess
    raise DataError(
        f"{where}: the position changes {ratio:.4g} times as fast as the velocity says, once wanted; {guess}. "
        "Name the unit or the sign in a column map (--columns MAP.toml), or drop the velocity."
    )
