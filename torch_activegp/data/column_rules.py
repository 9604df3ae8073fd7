"""One line of a column map: what it may say, and what that makes of a column."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping
from typing import Any

import numpy as np

from torch_activegp.data.units import unit_factor
from torch_activegp.errors import DataError


@dataclasses.dataclass(frozen=True)
class ColumnRule:
    """One line of a column map: where a column comes from, ``factor * raw + offset`` to SI, and when it acts."""

    column: str
    factor: float = 1.0
    offset: float = 0.0
    rows_late: int = 0
    hold_order: int = 0


_SETTINGS: dict[str, tuple[type, ...]] = {
    "column": (str,),
    "unit": (str,),
    "counts_per_turn": (int, float),
    "sign": (int, float),
    "scale": (int, float),
    "offset": (int, float),
}
_HELD = ("ctrl", "qfrc")
"""Kinds of column that act from row to row, and may be late by some."""
_IN_TIME = {
    "rows_late": (range(sys.maxsize), "0 rows or more"),
    "hold_order": ((0, 1, 3), "0 (held), 1 (evenly to the next row) or 3 (smoothly, a cubic spline)"),
}
"""Settings of these alone, whole numbers: what they may be."""


def read_rule(key: str, value: object, name: str) -> ColumnRule:
    """One line of a map as a rule.

    Args:
        key: the canonical name.
        value: the file's own name, or a table of settings.
        name: what messages call the map.

    Raises:
        DataError: a setting is unknown, of a wrong type, or contradicts another.
    """
    settings = {"column": value} if isinstance(value, str) else value
    if not isinstance(settings, Mapping):
        raise DataError(f"{name}: `{key}` wants the file's column name or a table of settings, found {value!r}.")
    for setting, content in settings.items():
        if setting in _IN_TIME:
            _check_in_time(key, setting, content, name)
        elif setting not in _SETTINGS:
            known = ", ".join([*_SETTINGS, *_IN_TIME])
            raise DataError(f"{name}: `{key}` has an unknown setting `{setting}`: use {known}.")
        elif isinstance(content, bool) or not isinstance(content, _SETTINGS[setting]):
            raise DataError(f"{name}: `{setting}` of `{key}` is {content!r}: {_SETTINGS[setting][0].__name__} wanted.")
    if key == "run":
        return ColumnRule(settings.get("column", key))
    in_time = {setting: settings[setting] for setting in _IN_TIME if setting in settings}
    offset = float(settings.get("offset", 0.0))
    return ColumnRule(settings.get("column", key), _factor(key, settings, name), offset, **in_time)


def _check_in_time(key: str, setting: str, value: object, name: str) -> None:
    """Refuses settings of columns that act from row to row, where they are of another column or none of the allowed."""
    allowed, wanted = _IN_TIME[setting]
    if key.partition(".")[0] not in _HELD:
        raise DataError(f"{name}: `{setting}` of `{key}`: a column of {' or '.join(_HELD)} wanted; no other has it.")
    if isinstance(value, bool) or not isinstance(value, int) or value not in allowed:
        raise DataError(f"{name}: `{setting}` of `{key}` is {value!r}: {wanted} wanted.")


def _factor(key: str, settings: Mapping[str, Any], name: str) -> float:
    factor = float(settings.get("scale", 1.0))
    if settings.get("sign", 1) not in (1, -1):
        raise DataError(f"{name}: `sign` of `{key}` is {settings['sign']}: 1 or -1 wanted.")
    if factor == 0 or not np.isfinite(factor):
        raise DataError(f"{name}: `scale` of `{key}` is {factor}: a finite number other than 0 wanted.")
    kind = key.partition(".")[0]
    if "unit" in settings or "counts_per_turn" in settings:
        try:
            factor *= unit_factor(kind, settings.get("unit", "(none)"), settings.get("counts_per_turn"))
        except DataError as error:
            raise DataError(f"{name}, `{key}`: {error}") from error
    return factor * settings.get("sign", 1)
