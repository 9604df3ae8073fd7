"""Column maps of public data sets, so that their files load as their authors published them."""

from __future__ import annotations

import pandas as pd

from torch_activegp.data.columns import ColumnMap, ColumnRule

EMPS_COLUMNS = ColumnMap(
    {"time": ColumnRule("t"), "qpos.slide": ColumnRule("qm"), "ctrl.motor": ColumnRule("vir")}, name="the map of EMPS"
)
"""EMPS: clock [s], measured position [m] and motor voltage [V]; see :mod:`torch_activegp.data.emps`."""

_SIGNATURES = ((frozenset({"t", "qm", "qg", "vir"}), EMPS_COLUMNS),)


def known_map(table: pd.DataFrame) -> ColumnMap | None:
    """Return the map of a data set that is recognised by its own column names, else None."""
    names = set(map(str, table.columns))
    return next((columns for signature, columns in _SIGNATURES if signature <= names), None)
