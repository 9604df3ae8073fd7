"""How a parameter is to be read: the value that means nothing, and where on a body something sits."""

from __future__ import annotations

from typing import Any

from torch_activegp.report.numbers import is_number, quantity

_GAINS = ("actuator_gain", "sensor_gain")


def nothing(effect: str, parameter: str) -> float:
    """The value with which nothing is wrong: one for a gain, else zero.

    Example:
        >>> nothing("sensor_gain", "gain"), nothing("viscous_friction", "coefficient")
        (1.0, 0.0)
    """
    return 1.0 if effect in _GAINS and parameter == "gain" else 0.0


def holds_nothing(effect: str, parameter: str, interval: Any) -> bool:
    """Whether an interval has the value with which nothing is wrong between its ends."""
    if interval is None or len(interval) != 2 or not all(map(is_number, interval)):
        return False
    return bool(interval[0] < nothing(effect, parameter) < interval[1])


def where(effect: str, parameter: str, value: Any) -> str:
    """In words, where a payload or a centre of mass sits; empty for parameters that are no place on a body.

    Example:
        >>> where("payload_mass", "offset_x", -0.25).replace("\u00a0", " ")
        "0.25 m from the body's nominal centre of mass, against the body's own x axis"
    """
    if effect not in ("payload_mass", "center_of_mass_offset") or not is_number(value):
        return ""
    size = quantity(abs(value), "m")
    if parameter == "distance":
        sense = "away from" if value < 0 else "towards"
        return f"{size} from the body's nominal centre of mass, {sense} the body's end farthest from its joint"
    kind, _, axis = parameter.rpartition("_")
    if kind != "offset":
        return ""
    sense = "against" if value < 0 else "along"
    return f"{size} from the body's nominal centre of mass, {sense} the body's own {axis} axis"
