from __future__ import annotations

import math

import pytest

from torch_activegp.data.column_rules import ColumnRule, read_rule
from torch_activegp.errors import DataError


def test_a_line_says_where_a_column_comes_from_and_when_it_acts() -> None:
    assert read_rule("qpos.a", "x", "map.toml") == ColumnRule("x")
    assert read_rule("qpos.a", {"unit": "mrad", "sign": -1, "offset": 2}, "map.toml") == ColumnRule(
        "qpos.a", -1e-3, 2.0
    )
    line = {"column": "u", "rows_late": 2, "hold_order": 1}
    assert read_rule("ctrl.a", line, "map.toml") == ColumnRule("u", rows_late=2, hold_order=1)
    assert read_rule("run", {"column": "trial"}, "map.toml") == ColumnRule("trial")


@pytest.mark.parametrize(
    ("key", "line", "message"),
    [
        ("qpos.a", 3, "`qpos.a` wants the file's column name or a table of settings, found 3"),
        ("qpos.a", {"colum": "x"}, "unknown setting `colum`: use column, unit"),
        ("qpos.a", {"scale": "2"}, "`scale` of `qpos.a` is '2': int wanted"),
        ("qpos.a", {"sign": True}, "`sign` of `qpos.a` is True"),
        ("qpos.a", {"sign": 2}, "`sign` of `qpos.a` is 2: 1 or -1 wanted"),
        ("qpos.a", {"scale": 0}, "`scale` of `qpos.a` is 0"),
        ("qpos.a", {"scale": math.inf}, "finite number other than 0"),
        ("qpos.a", {"unit": "rpm"}, "map.toml, `qpos.a`: unit `rpm` is not a unit of qpos"),
        ("qpos.a", {"counts_per_turn": 4096}, "goes with counts"),
        ("ctrl.a", {"rows_late": -1}, "`rows_late` of `ctrl.a` is -1: 0 rows or more wanted"),
        (
            "ctrl.a",
            {"hold_order": 2},
            r"`hold_order` of `ctrl.a` is 2: 0 \(held\), 1 \(evenly .*\) or 3 \(smoothly, a cubic spline\) wanted",
        ),
        ("qpos.a", {"hold_order": 0}, "`hold_order` of `qpos.a`: a column of ctrl or qfrc wanted; no other has it"),
        ("ctrl.a", {"rows_late": 0.5}, "`rows_late` of `ctrl.a` is 0.5: 0 rows or more wanted"),
        ("ctrl.a", {"hold_order": "first"}, r"`hold_order` of `ctrl.a` is 'first': 0 \(held\), 1"),
        ("ctrl.a", {"hold_order": True}, "`hold_order` of `ctrl.a` is True: 0"),
        ("qpos.a", {"rows_late": 1}, "`rows_late` of `qpos.a`: a column of ctrl or qfrc wanted"),
    ],
)
def test_a_line_that_cannot_be_used_is_refused(key: str, line: object, message: str) -> None:
    with pytest.raises(DataError, match=message):
        read_rule(key, line, "map.toml")
