from __future__ import annotations

import math

import pytest

from torch_activegp.data.units import unit_factor
from torch_activegp.errors import DataError


@pytest.mark.parametrize(
    ("kind", "unit", "value", "si"),
    [
        ("time", "ms", 1500, 1.5),
        ("time", "min", 2, 120),
        ("qpos", "deg", 180, math.pi),
        ("qpos", "turn", 1, 2 * math.pi),
        ("qpos", "mm", 250, 0.25),
        ("qvel", "rpm", 60, 2 * math.pi),
        ("qvel", "deg/s", 90, math.pi / 2),
        ("qvel", "mm/s", 5, 0.005),
        ("qfrc", "mN m", 3, 0.003),
        ("ctrl", "%", 50, 0.5),
        ("ctrl", "mA", 20, 0.02),
        ("qpos", "rev", 2, 4 * math.pi),
        ("qpos", "degrees", 90, math.pi / 2),
        ("qvel", "revolutions/second", 1, 2 * math.pi),
        ("qvel", "revs / minute", 60, 2 * math.pi),
        ("qvel", "RPM", 60, 2 * math.pi),
        ("time", "milliseconds", 5, 5e-3),
        ("qvel", "deg/sec", 180, math.pi),
        ("qfrc", "Nm", 2, 2.0),
        ("time", "µs", 5, 5e-6),
    ],
)
def test_a_value_in_si(kind: str, unit: str, value: float, si: float) -> None:
    assert value * unit_factor(kind, unit) == pytest.approx(si, rel=1e-12)


@pytest.mark.parametrize(
    ("kind", "unit"), [("qpos", "counts"), ("qpos", "count"), ("qvel", "counts/s"), ("qvel", "ticks/sec")]
)
def test_a_full_turn_of_counts_is_two_pi(kind: str, unit: str) -> None:
    assert 4096 * unit_factor(kind, unit, counts_per_turn=4096) == pytest.approx(2 * math.pi)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("qpos", "degs"), "unit `degs` is not a unit of qpos: use one of rad,.*counts"),
        (("qvel", "degrees"), "unit `degrees` is not a unit of qvel"),
        (("time", "deg"), "not a unit of time: use one of s, ms"),
        (("ctrl", "counts"), "not a unit of ctrl"),
        (("qpos", "counts"), "needs `counts_per_turn` > 0, found None"),
        (("qpos", "counts", 0), "found 0"),
        (("qpos", "deg", 360), "`counts_per_turn` goes with counts, found unit `deg`"),
    ],
)
def test_a_unit_of_another_kind_is_refused(arguments: tuple, message: str) -> None:
    with pytest.raises(DataError, match=message):
        unit_factor(*arguments)
