from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.report.unknowns import unknowns


@pytest.mark.parametrize(
    ("verdict", "point"),
    [
        ("none", "Effects too weak to rise above the noise"),
        ("named", "What happens at speeds, loads and positions that these recordings never reached."),
        ("tie", "Whether it is actuator gain at actuator shoulder_motor or payload mass at body forearm"),
        ("tie", "the 12\u00a0% left unexplained: it cannot be told from noise"),
        ("unknown", "the 74\u00a0% left unexplained: it still has structure, so it is not noise"),
    ],
)
def test_points(fakes: Any, verdict: str, point: str) -> None:
    assert any(point in found for found in unknowns(*fakes[verdict]()).content["points"])


def test_without_a_name_it_is_said_what_comes_closest_leaves() -> None:
    points = unknowns({"verdict": "unknown", "unexplained": {"share": 0.033, "white": False}}, {}).content["points"]
    assert "What makes up the mismatch: the effects that come closest leave 3.3\u00a0% of it." in points


@pytest.mark.parametrize("share", [1.0, 0.12])
def test_what_is_left_and_no_noise_is_said(share: float) -> None:
    left = {"share": share, "white": False}
    effects = [{"name": "cogging", "target": "joint:a"}] if share < 1.0 else []
    points = unknowns({"verdict": "named", "effects": effects, "unexplained": left}, {}).content["points"]
    told = f"{100 * share:.0f}\u00a0% left unexplained: it still has structure, so it is not noise"
    assert any(told in point for point in points)


def test_the_next_recording(fakes: Any) -> None:
    section = unknowns(*fakes["tie"]())
    assert section.heading == "What these recordings cannot tell, and the one that would"
    assert section.content["next"]["separates"] == "actuator gain from payload mass"
    assert section.content["next"]["controls"] == "next.csv"
    assert section.content["next"]["heading"] == "Record this next"
    assert unknowns(*fakes["named"]()).content["next"] is None


def test_what_need_not_be_recorded_is_not_asked_for(fakes: Any) -> None:
    diagnosis, evidence = fakes["tie"]()
    diagnosis["next_experiment"] = {**diagnosis["next_experiment"], "needed": False}
    section = unknowns(diagnosis, evidence)
    assert section.heading == "What these recordings cannot tell"
    assert section.content["next"]["heading"] == "The next recording"


def test_the_next_recording_tells_parameters_by_their_own_names(fakes: Any) -> None:
    diagnosis, evidence = fakes["tie"]()
    told = ["level of coulomb_friction at joint:joint_a 0.1 N m", "the rest"]
    diagnosis["next_experiment"] = {**diagnosis["next_experiment"], "separates": told}
    assert unknowns(diagnosis, evidence).content["next"]["separates"] == " from ".join(told)


def test_an_open_sign_is_a_question() -> None:
    effect = {"name": "cogging", "target": "joint:a", "parameters": {"phase": {"value": 0.0, "ci95": [-1.0, 1.0]}}}
    points = unknowns({"verdict": "named", "effects": [effect]}, {}).content["points"]
    assert points[0] == "Whether the phase of cogging at joint a is above or below zero: the interval holds both."


def test_a_gain_is_open_around_one() -> None:
    gain = {"value": 1.0, "ci95": [0.9, 1.1]}
    effects = [
        {"name": "actuator_gain", "target": "actuator:a", "parameters": {"gain": gain}},
        {"name": "viscous_friction", "target": "joint:a", "parameters": {"coefficient": gain}},
    ]
    open_ones = [p for p in unknowns({"verdict": "named", "effects": effects}, {}).content["points"] if "interval" in p]
    assert open_ones == [
        "Whether the gain of actuator gain at actuator a is above or below one: the interval holds both."
    ]
