"""Units that a recording may be written in, as factors to SI."""

from __future__ import annotations

import math

from torch_activegp.errors import DataError

_TURN = 2 * math.pi
_TIME = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
_POSITION = {
    "rad": 1.0,
    "mrad": 1e-3,
    "deg": math.pi / 180,
    "turn": _TURN,
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
}
_VELOCITY = {f"{unit}/s": factor for unit, factor in _POSITION.items()} | {"rpm": _TURN / 60}
_FORCE = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "N m": 1.0, "mN m": 1e-3}
_CONTROL = _FORCE | _POSITION | _VELOCITY | {"V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3, "1": 1.0, "%": 1e-2}
_COUNTS = {"qpos": "counts", "qvel": "counts/s"}

_SPELLINGS = {
    "turn": ("turns", "rev", "revs", "revolution", "revolutions"),
    "deg": ("degree", "degrees", "°"),
    "rad": ("radian", "radians"),
    "m": ("meter", "meters", "metre", "metres"),
    "mm": ("millimeter", "millimeters", "millimetre", "millimetres"),
    "um": ("µm", "μm"),
    "s": ("sec", "second", "seconds"),
    "ms": ("millisecond", "milliseconds"),
    "us": ("µs", "μs"),
    "min": ("minute", "minutes"),
    "N m": ("Nm", "N*m", "N.m", "N·m"),
    "mN m": ("mNm", "mN*m", "mN.m", "mN·m"),
    "counts": ("count", "ticks"),
}
_SPELT = {other: unit for unit, others in _SPELLINGS.items() for other in others}
_PER_MINUTE = {"turn/min": "rpm", "RPM": "rpm"}

UNITS = {"time": _TIME, "qpos": _POSITION, "qvel": _VELOCITY, "qfrc": _FORCE, "ctrl": _CONTROL}
"""Factor to SI of each unit, by kind of column."""


def unit_factor(kind: str, unit: str, counts_per_turn: float | None = None) -> float:
    """Return the factor that turns a value in ``unit`` into SI.

    Args:
        kind: ``time``, ``qpos``, ``qvel``, ``ctrl`` or ``qfrc``.
        unit: a unit of that kind, such as ``"deg"`` or ``"rpm"``, or another usual spelling of it (``"degrees"``,
            ``"rev/s"``, ``"Nm"``); ``"counts"`` (``qpos``) and ``"counts/s"`` (``qvel``) are encoder steps.
        counts_per_turn: encoder steps in one turn; needed for counts and for nothing else.

    Raises:
        DataError: if the unit does not belong to the kind, or the encoder's resolution is missing or superfluous.

    >>> round(unit_factor("qvel", "rpm"), 4)
    0.1047
    """
    usual = "/".join(_SPELT.get(part.strip(), part.strip()) for part in unit.split("/"))
    usual = _PER_MINUTE.get(usual, usual)
    if usual == _COUNTS.get(kind):
        if counts_per_turn is None or not counts_per_turn > 0:
            raise DataError(f"unit `{unit}` needs `counts_per_turn` > 0, found {counts_per_turn}: add it to the table.")
        return _TURN / counts_per_turn
    if counts_per_turn is not None:
        raise DataError(f"`counts_per_turn` goes with counts, found unit `{unit}`: drop it or use unit `counts`.")
    if usual not in UNITS[kind]:
        known = [*UNITS[kind], *([_COUNTS[kind]] if kind in _COUNTS else [])]
        raise DataError(f"unit `{unit}` is not a unit of {kind}: use one of {', '.join(known)}, or give a `scale`.")
    return UNITS[kind][usual]
