from __future__ import annotations

from typing import Any

from torch_activegp.report.parameters import parameters


def test_rows_hold_value_unit_and_interval(fakes: Any) -> None:
    section = parameters(*fakes["named"]())
    assert section.heading == "2 parameters fitted, with their 95 % intervals"
    (row,) = section.content["effects"][0]["rows"]
    assert (row["value"], row["unit"], row["interval"]) == ("0.312", "N m", "0.293 to 0.331")
    assert row["picture"]["origin"] == 4.0
    assert row["picture"]["start"] < row["picture"]["value"] < row["picture"]["start"] + row["picture"]["width"] <= 96.1
    assert section.content["retuned"][0]["name"] == "Viscous friction at joint elbow"


def _section(**found: Any) -> Any:
    effect = {"name": "cogging", "target": "joint:a", "parameters": {"rest_angle": found}}
    return parameters({"verdict": "named", "effects": [effect]}, {})


def test_an_interval_around_zero_is_said() -> None:
    section = _section(value=0.1, ci95=[-0.2, 0.4], unit="rad")
    assert section.heading == "1 parameter fitted; 1 could as well be zero"
    assert section.content["effects"][0]["rows"][0]["loose"]


def test_without_interval_there_is_no_picture() -> None:
    section = _section(value=0.1)
    assert section.heading == "1 parameter fitted"
    assert section.content["effects"][0]["rows"][0]["picture"] is None
    assert _section(value=0.0, ci95=[0.0, 0.0]).content["effects"][0]["rows"][0]["picture"] is None


def test_only_nuisances_or_nothing(fakes: Any) -> None:
    assert parameters({"verdict": "none", "effects": [{"name": "cogging"}]}, {}) is None
    assert parameters(*fakes["tie"]()).heading == "1 parameter fitted, with its 95 % interval"
    diagnosis, _ = fakes["unknown"]()
    assert parameters(diagnosis | {"effects": []}, {}).heading == "1 parameter fitted along"


def _named(name: str, parameter: str, **found: Any) -> Any:
    effect = {"name": name, "target": "body:a", "parameters": {parameter: found}}
    return parameters({"verdict": "named", "effects": [effect]}, {})


def test_a_gain_is_drawn_from_one(fakes: Any) -> None:
    (group,) = parameters(*fakes["tie"]()).content["effects"]
    picture = group["rows"][0]["picture"]
    assert (picture["origin"], picture["start"]) == (96.0, 4.0)
    section = _named("sensor_gain", "gain", value=1.01, ci95=[0.99, 1.03])
    assert section.heading == "1 parameter fitted; 1 could as well be one"
    assert section.content["effects"][0]["rows"][0]["nothing"] == "one"
    assert section.content["origins"] == ["From one", "From "]


def test_zero_and_one_are_both_said_where_both_are_drawn(fakes: Any) -> None:
    gain = {"name": "actuator_gain", "target": "actuator:a", "parameters": {"gain": {"value": 1.1, "ci95": [0.9, 1.3]}}}
    bias = {"name": "actuator_bias", "target": "actuator:a", "parameters": {"bias": {"value": 0.1, "ci95": [-1, 1.2]}}}
    section = parameters({"verdict": "named", "effects": [gain, bias]}, {})
    assert section.heading == "2 parameters fitted; 2 could as well be zero or one"
    assert section.content["origins"][0] == "From zero or one"


def test_where_a_payload_sits_is_said_in_words() -> None:
    (row,) = _named("payload_mass", "distance", value=0.05, ci95=[0.04, 0.06]).content["effects"][0]["rows"]
    assert row["where"].replace("\u00a0", " ").startswith("50 mm from the body's nominal centre of mass, towards")
    (row,) = _named("payload_mass", "mass", value=0.05, ci95=[0.04, 0.06]).content["effects"][0]["rows"]
    assert row["where"] == ""


def test_what_the_simulator_has_too_much_of_is_marked(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    first, second = diagnosis["effects"]
    section = parameters(diagnosis | {"effects": [first | {"too_much": True}, second]}, evidence)
    assert [group["excess"] for group in section.content["effects"]] == [True, False]


def test_a_ratio_has_no_unit() -> None:
    rows = {
        unit: _section(value=0.1, ci95=[0.05, 0.15], unit=unit).content["effects"][0]["rows"] for unit in ("1", "m")
    }
    assert [row["unit"] for (row,) in rows.values()] == ["", "m"]
