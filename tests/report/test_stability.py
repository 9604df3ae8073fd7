from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.report.stability import stability


def test_rows_hold_the_range_the_shift_and_what_was_left_out(fakes: Any) -> None:
    section = stability(*fakes["named"]())
    coulomb, delay = section.content["groups"]
    assert coulomb["name"] == "Coulomb friction at joint elbow"
    assert (coulomb["forecasts"], coulomb["rests"]) == ("forecasts 6 of 6 better", "")
    (row,) = coulomb["rows"]
    assert row == {
        "name": "level",
        "range": "0.308 to 0.315",
        "unit": "N m",
        "shift": "0.42",
        "farthest": "bench_03.csv",
    }
    assert (delay["forecasts"], delay["rests"]) == ("forecasts 3 of 6 better", "rests on bench_04.csv")
    assert section.content["sentence"].startswith("Each recording left out in turn")


def test_the_heading_is_the_finding(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    found = diagnosis["stability"]
    headings = [
        stability(diagnosis | {"stability": found | changes}, evidence).heading
        for changes in (
            {},
            {"effects": found["effects"][:1], "sound": True},
            {"effects": found["effects"][:1], "sound": False},
        )
    ]
    assert headings == [
        "Not every recording shows it: Actuator delay at actuator shoulder_motor",
        "Stands whichever recording is left out",
        "Changes with the recording that is left out",
    ]


def test_one_value_alone_is_no_range_and_no_value_is_no_row() -> None:
    spread = {"low": 0.3, "high": 0.3, "shift": 0.0, "farthest": "a"}
    effects = [
        {"name": "cogging", "parameters": {"amplitude": spread}},
        {"name": "backlash", "gains": [None, None], "rests_on": ["a", "b"], "parameters": {}},
    ]
    groups = stability({"stability": {"effects": effects}}, {}).content["groups"]
    assert groups[0]["rows"][0]["range"] == "0.3"
    assert (groups[1]["rows"], groups[1]["rests"]) == ([], "rests on a and b")


@pytest.mark.parametrize("found", [{}, {"stability": None}])
def test_nothing_left_out_is_no_section(found: dict[str, Any]) -> None:
    assert stability(found, {}) is None
