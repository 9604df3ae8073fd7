from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.report.reading import holds_nothing, nothing, where


@pytest.mark.parametrize(
    ("effect", "parameter", "value"),
    [
        ("actuator_gain", "gain", 1.0),
        ("sensor_gain", "gain", 1.0),
        ("actuator_bias", "bias", 0.0),
        ("my_own_effect", "gain", 0.0),
    ],
)
def test_only_the_gains_of_drives_and_sensors_mean_nothing_at_one(effect: str, parameter: str, value: float) -> None:
    assert nothing(effect, parameter) == value
    assert holds_nothing(effect, parameter, [value - 0.1, value + 0.1])
    assert not holds_nothing(effect, parameter, [value + 0.1, value + 0.2])


@pytest.mark.parametrize("interval", [None, [], [None, 1.0], [0.0, float("nan")], [-1.0, 1.0, 2.0]])
def test_what_is_no_interval_holds_nothing_at_all(interval: Any) -> None:
    assert not holds_nothing("cogging", "phase", interval)


@pytest.mark.parametrize(
    ("effect", "parameter", "value", "words"),
    [
        ("payload_mass", "distance", 0.12, "0.12 m from the body's nominal centre of mass, towards the body's end"),
        ("payload_mass", "distance", -0.03, "30 mm from the body's nominal centre of mass, away from the body's end"),
        ("payload_mass", "offset_y", 0.03, "30 mm from the body's nominal centre of mass, along the body's own y axis"),
        ("center_of_mass_offset", "offset_z", -0.03, "against the body's own z axis"),
    ],
)
def test_places_on_a_body_in_words(effect: str, parameter: str, value: float, words: str) -> None:
    assert words in where(effect, parameter, value).replace("\u00a0", " ")


@pytest.mark.parametrize(
    ("effect", "parameter", "value"),
    [("payload_mass", "mass", 0.1), ("joint_stop", "distance", 0.1), ("payload_mass", "distance", None)],
)
def test_other_numbers_are_no_place_on_a_body(effect: str, parameter: str, value: float | None) -> None:
    assert where(effect, parameter, value) == ""
