"""From files to recordings: read, map the columns, split into runs, check."""

from __future__ import annotations

import glob
import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from torch_activegp.data.checks import MIN_ROWS, check_columns
from torch_activegp.data.columns import ColumnMap
from torch_activegp.data.known_maps import known_map
from torch_activegp.data.recording import Recording
from torch_activegp.data.tables import read_table
from torch_activegp.errors import DataError

GAP = 5.0
"""A step of more than this many median steps is a gap, and splits a run."""

Paths = str | Path | Sequence[str | Path]


def load_recordings(paths: Paths, columns: ColumnMap | Mapping[str, Any] | str | Path | None = None) -> list[Recording]:
    """Load all runs of one or more files.

    A file holds one run, or several that its ``run`` column tells apart. Where the clock leaps by more than 5 median
    steps, the run is split there, and the notes of both parts say so; a part of fewer than 4 rows is left out, and the
    notes say that too.

    Args:
        paths: a file, a pattern such as ``"run*.csv"``, or a sequence of them. See
            :func:`~torch_activegp.data.tables.read_table` for the kinds of file.
        columns: how the file's columns become canonical ones: a map, the path of a TOML file, or what it holds; see
            :mod:`torch_activegp.data.columns`. Without it, every column has its canonical name already. The files of
            the EMPS benchmark are known and need none.

    Returns:
        Runs in the order of the files, and within a file in order of their first row.

    Raises:
        DataError: if anything is missing or wrong; the message names file, column and row.
    """
    chosen = _column_map(columns)
    return [recording for path in _expand(paths) for recording in _load(path, chosen)]


def _column_map(columns: ColumnMap | Mapping[str, Any] | str | Path | None) -> ColumnMap | None:
    if columns is None or isinstance(columns, ColumnMap):
        return columns
    return ColumnMap.from_mapping(columns) if isinstance(columns, Mapping) else ColumnMap.from_toml(columns)


def _expand(paths: Paths) -> list[Path]:
    given = [paths] if isinstance(paths, str | Path) else list(paths)
    if not given:
        raise DataError("no recording given. Name at least one file.")
    files: list[Path] = []
    for item in map(str, given):
        matches = sorted(glob.glob(item)) if glob.has_magic(item) and not Path(item).exists() else [item]
        if not matches:
            raise DataError(f"{item}: no file matches the pattern. Check the folder and the ending.")
        files += map(Path, matches)
    return files


def _load(path: Path, chosen: ColumnMap | None) -> Iterator[Recording]:
    raw = read_table(path)
    columns = chosen or known_map(raw) or ColumnMap()
    table = columns.apply(raw, path.name)
    notes = columns.notes(raw)
    if "run" not in table:
        yield from _split(table, path, None, notes, columns)
        return
    for run, rows in table.groupby("run", sort=False):
        yield from _split(rows.drop(columns="run"), path, str(run), notes, columns)


def _split(
    table: pd.DataFrame, path: Path, run: str | None, notes: Sequence[str], columns: ColumnMap
) -> Iterator[Recording]:
    """Check one run, and cut it where its clock has a gap."""
    rows = table.index.to_numpy() + 1
    where = path.name if run is None else f"{path.name} (run {run})"
    arrays = {str(name): table[name].to_numpy(dtype=np.float64) for name in table}
    check_columns(arrays, where, rows)
    steps = np.diff(arrays["time"])
    gaps = np.flatnonzero(steps > GAP * np.median(steps))
    cuts = [0, *(gaps + 1).tolist(), len(rows)]
    said = [f"Gap of {steps[gap]:.4g} s after row {rows[gap]}: the run is split there." for gap in gaps]
    pieces = list(itertools.pairwise(cuts))
    said += [
        f"Rows {rows[a]} to {rows[b - 1]} left out: a part of {b - a} rows is too short."
        for a, b in pieces
        if b - a < MIN_ROWS
    ]
    long_enough = [(a, b) for a, b in pieces if b - a >= MIN_ROWS]
    if not long_enough:
        raise DataError(f"{where}: too short, no {MIN_ROWS} rows without a gap. {said[0]} Record without gaps.")
    for number, (a, b) in enumerate(long_enough, start=1):
        part = run if not gaps.size else (f"{run}.{number}" if run else str(number))
        piece = {name: values[a:b] for name, values in arrays.items()}
        fields = {"run": part, "source": path, "notes": (*notes, *said)}
        yield Recording.from_columns(path.name, piece, prescribed=columns.prescribed, video=columns.video, **fields)
