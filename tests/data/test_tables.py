from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
import torch
from tensordict import TensorDict

from torch_activegp.data.tables import read_table
from torch_activegp.errors import DataError

TIME = np.arange(6) * 0.1
ANGLE = np.sin(TIME)


def write_csv(path: Path) -> None:
    pd.DataFrame({"time": TIME, "qpos.elbow": ANGLE}).to_csv(path, index=False)


def write_semicolons(path: Path) -> None:
    pd.DataFrame({"time": TIME, "qpos.elbow": ANGLE}).to_csv(path, index=False, sep=";")


def write_decimal_commas(path: Path) -> None:
    pd.DataFrame({"time": TIME, "qpos.elbow": ANGLE}).to_csv(path, index=False, sep=";", decimal=",")


def write_tabs(path: Path) -> None:
    pd.DataFrame({"time": TIME, "qpos.elbow": ANGLE}).to_csv(path, index=False, sep="\t")


def write_blanks(path: Path) -> None:
    np.savetxt(path, np.stack([TIME, ANGLE], axis=1), fmt="%.18e", header="time   qpos.elbow", comments="")


def write_spreadsheet_csv(path: Path) -> None:
    lines = [f"{time!r}, {angle!r}" for time, angle in zip(TIME.tolist(), ANGLE.tolist(), strict=True)]
    path.write_text("\ufeffTime , qpos.elbow \n".replace("Time", "time") + "\n".join(lines), encoding="utf-8")


def write_parquet(path: Path) -> None:
    pd.DataFrame({"time": TIME, "qpos.elbow": ANGLE}).to_parquet(path)


def write_npz(path: Path) -> None:
    np.savez(path, **{"time": TIME, "qpos.elbow": ANGLE[:, None]})


def write_flat_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        file["qpos.elbow"] = ANGLE


def write_nested_hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"] = TIME
        file["qpos/elbow"] = ANGLE


def write_mat(path: Path) -> None:
    scipy.io.savemat(path, {"time": TIME[:, None], "angle": ANGLE[:, None], "gain": 3.0})


def write_memmap(path: Path) -> None:
    data = {"time": torch.from_numpy(TIME), ("qpos", "elbow"): torch.from_numpy(ANGLE)}
    TensorDict(data, batch_size=[6]).memmap(path)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.csv", write_csv),
        ("a.CSV", write_semicolons),
        ("a.csv", write_decimal_commas),
        ("a.tsv", write_tabs),
        ("a.txt", write_blanks),
        ("b.csv", write_spreadsheet_csv),
        ("a.parquet", write_parquet),
        ("a.npz", write_npz),
        ("a.h5", write_flat_hdf5),
        ("a.hdf5", write_nested_hdf5),
        ("a.mat", write_mat),
        ("folder", write_memmap),
    ],
)
def test_every_format_gives_the_same_table(tmp_path: Path, name: str, write: Callable[[Path], None]) -> None:
    write(tmp_path / name)
    table = read_table(tmp_path / name).rename(columns={"angle": "qpos.elbow"})
    assert set(table.columns) == {"time", "qpos.elbow"}
    np.testing.assert_array_equal(table["time"], TIME)
    np.testing.assert_array_equal(table["qpos.elbow"], ANGLE)


def test_text_in_hdf5_is_text(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["run"] = ["first", "second"]
    assert read_table(tmp_path / "a.h5")["run"].tolist() == ["first", "second"]


def test_spoilt_text_in_hdf5_gets_no_advice_on_text_files(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("run", data=np.array([b"\xff"], dtype=object), dtype=h5py.string_dtype())
    with pytest.raises(DataError, match="a.h5: cannot be read as .h5: .*0xff"):
        read_table(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.xlsx", b"x", "a.xlsx: cannot read `.xlsx` files: .csv, "),
        ("recording", b"x", "recording: cannot read `` files"),
        ("a.csv", b"", "a.csv: the file is empty"),
        ("a.csv", b"time,qpos.a\n", "a.csv: no data rows found, column names are time, qpos.a"),
        ("a.csv", b"time,qpos.a\n1,2\n1,2,3\n", "a.csv: cannot be read as .csv: .*line 3"),
        ("a.csv", b"time,qpos.a\n1,2,3\n", "a.csv: cannot be read as .csv: Length of header"),
        ("a.csv", b"\n\n", "a.csv: "),
        ("a.csv", b"\xff\xfe\x00\x01", "a.csv: text in UTF-8 wanted, found byte 0xff at 0. Save it as UTF-8, or"),
        ("a.csv", "time,angle [°]\n0,1\n".encode("cp1252"), "text in UTF-8 wanted, found byte 0xb0 at 12"),
        ("a.parquet", b"nonsense", "a.parquet: cannot be read as .parquet"),
        ("a.npz", b"nonsense", "a.npz: cannot be read as .npz"),
        ("a.npz", b"PK\x03\x04nonsense", "a.npz: cannot be read as .npz"),
        ("a.h5", b"nonsense", "a.h5: cannot be read as .h5"),
        ("a.mat", b"nonsense" * 40, "a.mat: cannot be read as .mat"),
    ],
)
def test_a_file_that_is_no_table_is_refused(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=message):
        read_table(tmp_path / name)


def test_a_missing_file_and_a_strange_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="none.csv: no such file or folder"):
        read_table(tmp_path / "none.csv")
    with pytest.raises(DataError, match="is no TensorDict memmap"):
        read_table(tmp_path)


def test_arrays_that_are_no_columns_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=TIME, q=np.zeros((6, 2)))
    with pytest.raises(DataError, match=r"a.npz, column `q`: shape \(T,\) wanted, found \(6, 2\)"):
        read_table(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", time=TIME, q=np.zeros(5))
    with pytest.raises(DataError, match="b.npz: columns differ in length .*'q': 5"):
        read_table(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", time=np.array([None, 1]))
    with pytest.raises(DataError, match="c.npz: cannot be read as .npz: .*allow_pickle"):
        read_table(tmp_path / "c.npz")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("time;qpos.a\n0;0\n0,01;-0,5\n", [0.0, -0.5]),  # the first row has none
        ('time;qpos.a\n"0,00";"-0,5"\n"0,01";"1,5e-3"\n', [-0.5, 1.5e-3]),
        ("time;qpos.a\n0,0;\n0,1;,5\n", [np.nan, 0.5]),
        ("time\tqpos.a\n0,5\t3\n0,6\t4\n", [3.0, 4.0]),
    ],
)
def test_decimal_commas_are_read_between_other_separators(tmp_path: Path, text: str, values: list[float]) -> None:
    (path := tmp_path / "a.csv").write_text(text)
    np.testing.assert_allclose(read_table(path)["qpos.a"], values)


def test_commas_are_no_decimals_where_there_are_points(tmp_path: Path) -> None:
    (path := tmp_path / "a.csv").write_text("time;run\n0.1;1,5\n0.2;1,6\n")
    assert read_table(path)["run"].tolist() == ["1,5", "1,6"]
