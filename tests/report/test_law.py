from __future__ import annotations

from typing import Any

import numpy as np

from torch_activegp.report.law import law


def test_each_law_is_drawn_over_its_force(fakes: Any) -> None:
    section = law(*fakes["named"]())
    first, second = section.content["charts"]
    assert first.title.replace("\u00a0", " ") == "Coulomb friction at joint elbow explains 91 % of the mismatch"
    assert (first.x.label, first.y.label) == ("qvel.elbow [rad/s]", "missing force [N m]")
    assert [mark.look for mark in first.marks] == ["zero", "whiskers", "dots few", "law"]
    assert [mark.look for mark in second.marks] == ["zero", "dots", "law"]
    assert first.marks[-1].label == "law: -F sign(v), with sticking"


def test_effects_without_a_curve_are_said_not_to_be_drawn(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    assert law(diagnosis, evidence).content["others"] == ""
    evidence["laws"] = evidence["laws"][:1]
    assert law(diagnosis, evidence).content["others"] == "Actuator delay at actuator shoulder_motor"


def test_an_outlier_among_many_points_does_not_flatten_the_law(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    evidence["laws"][1]["force"][7] = 1e4
    assert law(diagnosis, evidence).content["charts"][1].y.high < 1.0


def test_a_law_that_is_not_named_says_so_and_a_missing_line_is_left_out() -> None:
    found = {"name": "cogging", "target": "joint:a", "over": "qpos.a", "x": [0.0, 1.0], "force": [1.0, np.nan]}
    (chart,) = law({"verdict": "unknown"}, {"laws": [found]}).content["charts"]
    assert chart.title == "Cogging at joint a: not among the named effects"
    assert [mark.look for mark in chart.marks if mark.look == "law"] == []


def test_no_law_no_section() -> None:
    assert law({"verdict": "none"}, {"laws": []}) is None


def test_a_law_of_which_the_simulator_has_too_much_says_so(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    pairs = zip(diagnosis["effects"], (0.91, None), strict=True)
    effects = [{**effect, "too_much": True, "share": share} for effect, share in pairs]
    first, second = law(diagnosis | {"effects": effects}, evidence).content["charts"]
    assert first.title.replace("\u00a0", " ") == (
        "Coulomb friction at joint elbow, of which the simulator has too much, explains 91 % of the mismatch"
    )
    assert second.title == "Actuator delay at actuator shoulder_motor, of which the simulator has too much"
