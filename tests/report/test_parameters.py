from __future__ import annotations

from typing import Any

from torch_activegp.report.parameters import parameters


def test_rows_hold_value_unit_and_interval(fakes: Any) -> None:
    section = parameters(*fakes["named"]())
    assert section.heading == "2 parameters fitted, with their 95 % intervals"
    (row,) = section.content["effects"][0]["rows"]
    assert (row["value"], row["unit"], row["interval"]) == ("0.312", "N m", "0.293 to 0.331")
    assert row["picture"]["zero"] == 4.0
    assert row["picture"]["start"] < row["picture"]["value"] < row["picture"]["start"] + row["picture"]["width"] <= 96.1
    assert section.content["retuned"][0]["name"] == "Viscous friction at joint elbow"


def _section(**found: Any) -> Any:
    effect = {"name": "cogging", "target": "joint:a", "parameters": {"rest_angle": found}}
    return parameters({"verdict": "named", "effects": [effect]}, {})


def test_an_interval_around_zero_is_said() -> None:
    section = _section(value=0.1, ci95=[-0.2, 0.4], unit="rad")
    assert section.heading == "1 parameter fitted; 1 could as well be zero"
    assert section.content["effects"][0]["rows"][0]["loose"]


def test_a_vector_has_one_row_for_each_number() -> None:
    section = _section(value=[72, 18], unit="1/turn", ci95=[[71, 73], [17, 19]])
    assert [row["name"] for row in section.content["effects"][0]["rows"]] == ["rest angle 1", "rest angle 2"]
    assert [row["interval"] for row in section.content["effects"][0]["rows"]] == ["71.0 to 73.0", "17.0 to 19.0"]
    assert len(_section(value=[1.0, 2.0], ci95=None).content["effects"][0]["rows"]) == 2


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
