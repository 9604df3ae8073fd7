"""What docs/recordings.md says of formats, units and column maps, against the code that reads them."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from torch_activegp.data import ColumnMap
from torch_activegp.data.tables import SUFFIXES
from torch_activegp.data.units import UNITS

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "recordings.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("kind", ["time", "qpos", "qfrc", "ctrl"])
def test_every_unit_is_on_the_page(kind: str) -> None:
    table = PAGE.partition("| for | units |")[2]
    (row,) = re.findall(rf"^\| `{kind}` \| (.*) \|$", table, flags=re.MULTILINE)
    others = set(UNITS["qpos"]) | set(UNITS["qvel"]) | set(UNITS["qfrc"]) if "any of these" in row else set()
    assert set(UNITS[kind]) <= set(re.findall(r"`([^`]+)`", row)) | others


def test_velocities_are_positions_per_second_and_rpm() -> None:
    assert set(UNITS["qvel"]) == {f"{unit}/s" for unit in UNITS["qpos"]} | {"rpm"}


def test_every_kind_of_file_is_on_the_page_and_in_the_readme() -> None:
    for name in ("CSV", ".tsv", ".txt", "Parquet", "NPZ", "HDF5", "MAT"):
        assert name in PAGE
        assert name in (ROOT / "README.md").read_text(encoding="utf-8") or name.startswith(".")
    assert set(SUFFIXES) == {".csv", ".tsv", ".txt", ".parquet", ".npz", ".h5", ".hdf5", ".mat"}


def test_every_map_on_the_page_can_be_read_and_flips_what_it_says() -> None:
    first, *others = [tomllib.loads(block) for block in re.findall(r"```toml\n(.*?)```", PAGE, flags=re.DOTALL)]
    for mapping in others:
        ColumnMap.from_mapping(mapping)
    drives = {"u": [1.0, 2.0], "v": [3.0, 4.0], "pot": [5.0, 6.0], "qfrc.slide": [0.0, 1.0]}
    encoders = {"enc1": [0, 1024], "enc2": [0, 1000], "x": [0.0, 1000.0]}
    raw = pd.DataFrame({"t": [0, 10], "trial": ["slow", "slow"], **encoders, **drives})
    table = ColumnMap.from_mapping(first).apply(raw, "raw.csv")
    assert table["time"].tolist() == [0.0, 0.01]
    assert table["qpos.elbow"].tolist() == pytest.approx([0.0, -np.pi / 2])
    assert table["qpos.slide"].tolist() == pytest.approx([0.12, 1.12])
    assert table["qpos.drum"].tolist() == pytest.approx([0.0, 1.5e-3])
    assert table["run"].tolist() == ["slow", "slow"]
    assert table["ctrl.motor"].tolist() == [-1.0, -2.0]
    assert table["ctrl.valve"].tolist() == [4.0, 4.0]
    assert table["ctrl.knob"].tolist() == [5.5, 6.0]  # two rows have no spline
    assert table["qfrc.slide"].tolist() == pytest.approx([0.0, 9.81])
