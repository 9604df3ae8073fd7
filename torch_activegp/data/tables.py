"""Raw tables from files: CSV, Parquet, NPZ, HDF5, MAT, or a TensorDict memmap folder."""

from __future__ import annotations

import itertools
import re
import warnings
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import scipy.io

from torch_activegp.errors import DataError

_LOOK = 50
"""Rows that are looked at for decimal commas; none where one of them has a point."""
_COMMA, _POINT = (re.compile(rf"[+-]?\d*{mark}\d+([eE][+-]?\d+)?") for mark in (",", r"\."))


def read_table(path: Path) -> pd.DataFrame:
    """Read a file's columns as they are.

    Args:
        path: ``.csv``, ``.tsv``, ``.txt`` (separated by comma, semicolon, tab or white space, with a header;
            decimal commas where it is none of the commas),
            ``.parquet``, ``.npz`` (one array a column), ``.h5`` or ``.hdf5`` (one data set a column; in groups,
            ``qpos/elbow`` is ``qpos.elbow``), ``.mat`` (version 7 or older, one vector a column), or a folder written
            by :meth:`tensordict.TensorDict.memmap`.

    Returns:
        One row a sample, columns by the file's own names.

    Raises:
        DataError: if the file is missing, empty, damaged, of an unknown kind or not a table.
    """
    if not path.exists():
        raise DataError(f"{path}: no such file or folder. Give the path of a recording.")
    suffix = "folder" if path.is_dir() else path.suffix.lower()
    if suffix not in _READERS:
        raise DataError(f"{path.name}: cannot read `{suffix}` files: {', '.join(_READERS)} wanted.")
    if path.is_file() and path.stat().st_size == 0:
        raise DataError(f"{path.name}: the file is empty. Record again or leave it out.")
    try:
        table = _READERS[suffix](path)
    except DataError:
        raise
    except _DAMAGE as error:
        raise DataError(f"{path.name}: {_damage(suffix, error)}") from error
    if table.empty:
        raise DataError(
            f"{path.name}: no data rows found, column names are {', '.join(map(str, table.columns))}. "
            "Record again or leave it out."
        )
    return table


def _damage(suffix: str, error: Exception) -> str:
    """What is wrong with a file, and what to do."""
    if isinstance(error, UnicodeDecodeError) and _READERS[suffix] is _read_text:
        found = f"found byte 0x{error.object[error.start]:02x} at {error.start}"
        return f"text in UTF-8 wanted, {found}. Save it as UTF-8, or, if it is no text, give it the ending of its kind."
    return f"cannot be read as {suffix}: {error}. Mend the file or export it again."


def _read_text(path: Path) -> pd.DataFrame:
    with path.open(encoding="utf-8-sig") as file:
        header, rows = file.readline(), list(itertools.islice(file, _LOOK))
    found = [separator for separator in ",;\t" if separator in header]
    separator = found[0] if found else r"\s+"
    cells = [cell.strip(' "\n\r') for row in rows for cell in re.split(separator, row)]
    commas = any(map(_COMMA.fullmatch, cells)) and not any(map(_POINT.fullmatch, cells))
    with warnings.catch_warnings():
        warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header
        table = pd.read_csv(
            path,
            sep=separator,
            decimal="," if commas else ".",
            skipinitialspace=True,
            encoding="utf-8-sig",
            index_col=False,
        )
    return table.rename(columns=lambda name: str(name).strip())


def _read_npz(path: Path) -> pd.DataFrame:
    with path.open("rb") as file, np.lib.npyio.NpzFile(file, allow_pickle=False) as arrays:
        return _from_arrays({name: arrays[name] for name in arrays.files}, path)


def _read_hdf5(path: Path) -> pd.DataFrame:
    arrays: dict[str, np.ndarray] = {}

    def collect(name: str, item: object) -> None:
        if isinstance(item, h5py.Dataset):
            text = h5py.check_string_dtype(item.dtype) is not None
            arrays[name.replace("/", ".")] = np.asarray(item.asstr()[()] if text else item[()])

    with h5py.File(path, "r") as file:
        file.visititems(collect)
    return _from_arrays(arrays, path)


def _read_memmap(path: Path) -> pd.DataFrame:
    if not (path / "meta.json").is_file():
        raise DataError(f"{path}: a folder without `meta.json` is no TensorDict memmap. Give a file of it instead.")
    from tensordict import TensorDict  # takes longer to import than most files to read

    data = TensorDict.load_memmap(path).flatten_keys(".")
    return _from_arrays({name: value.cpu().numpy() for name, value in data.items()}, path)


def _read_mat(path: Path) -> pd.DataFrame:
    content = scipy.io.loadmat(path)
    vectors = {name: np.asarray(value) for name, value in content.items() if not name.startswith("__")}
    return _from_arrays({name: value for name, value in vectors.items() if value.shape != (1, 1)}, path)


def _from_arrays(arrays: Mapping[str, np.ndarray], path: Path) -> pd.DataFrame:
    """Join arrays ``(T,)`` or ``(T, 1)`` into one table."""
    columns = {}
    for name, array in arrays.items():
        flat = array[:, 0] if array.ndim == 2 and array.shape[1] == 1 else array
        if flat.ndim != 1:
            raise DataError(f"{path.name}, column `{name}`: shape (T,) wanted, found {array.shape}. Split it up.")
        columns[name] = flat
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        raise DataError(f"{path.name}: columns differ in length ({lengths}). Give every column one value a row.")
    return pd.DataFrame(columns)


_DAMAGE = (
    OSError,
    ValueError,
    KeyError,
    NotImplementedError,  # MAT files of version 7.3
    zipfile.BadZipFile,
    pa.ArrowException,
    pd.errors.ParserWarning,
    scipy.io.matlab.MatReadError,
)
_READERS: dict[str, Callable[[Path], pd.DataFrame]] = {
    ".csv": _read_text,
    ".tsv": _read_text,
    ".txt": _read_text,
    ".parquet": pd.read_parquet,
    ".npz": _read_npz,
    ".h5": _read_hdf5,
    ".hdf5": _read_hdf5,
    ".mat": _read_mat,
    "folder": _read_memmap,
}
SUFFIXES = tuple(suffix for suffix in _READERS if suffix != "folder")
"""Endings of the files that can be read."""
