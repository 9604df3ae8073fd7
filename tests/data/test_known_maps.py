from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from torch_activegp.data.known_maps import EMPS_COLUMNS, known_map

EMPS = ["t", "qm", "qg", "vir"]


@pytest.mark.parametrize("names", [EMPS, [*EMPS, "pulses_N"]])
def test_emps_is_known_by_its_columns(names: list[str]) -> None:
    table = pd.DataFrame({name: np.arange(3.0) + number for number, name in enumerate(names)})
    assert known_map(table) is EMPS_COLUMNS
    assert EMPS_COLUMNS.apply(table, "emps").to_dict("list") == {
        "time": [0, 1, 2],
        "qpos.slide": [1, 2, 3],
        "ctrl.motor": [3, 4, 5],
    }


@pytest.mark.parametrize("missing", EMPS)
def test_other_tables_are_not_known(missing: str) -> None:
    assert known_map(pd.DataFrame({name: [0.0] for name in EMPS if name != missing})) is None
