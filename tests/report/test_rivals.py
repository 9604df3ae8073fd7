from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.report.rivals import rivals


@pytest.mark.parametrize(
    ("verdict", "heading"),
    [
        ("none", "No effect improves on the simulator: the best is 7.9 points worse"),
        (
            "named",
            "Coulomb friction at joint elbow and actuator delay at actuator shoulder_motor: "
            "the next rival is 12 points worse",
        ),
        ("tie", "Several explanations fit these recordings equally well"),
        ("unknown", "The best known explanation is not good enough"),
    ],
)
def test_the_heading_is_the_finding(fakes: Any, verdict: str, heading: str) -> None:
    assert rivals(*fakes[verdict]()).heading == heading


def test_rows(fakes: Any) -> None:
    rows = rivals(*fakes["named"]()).content["rows"]
    assert [row["tag"] for row in rows] == ["the verdict", "", "", "", "", ""]
    assert [row["gap"] for row in rows] == ["best", "11.8", "13.9", "171", "640", "2210"]
    assert [row["word"] for row in rows] == ["", *["ruled out"] * 5]
    assert rows[-1]["name"] == "The simulator as it is"
    assert rows[-1]["probability"] == "under\u00a00.1\u00a0%"


def test_of_sets_that_are_not_enough_none_is_probable(fakes: Any) -> None:
    """The best of a search in vain left 2400 times the noise, at 100 %."""
    rows = rivals(*fakes["unknown"]()).content["rows"]
    assert {(row["probability"], row["width"]) for row in rows} == {("\u2013", 0.0)}


def test_what_fits_as_well_is_not_ruled_out_by_the_recordings(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    best, second, third, *_ = diagnosis["rivals"]
    second["chi2_per_dof"], third["chi2_per_dof"] = best["chi2_per_dof"], 1.5 * best["chi2_per_dof"]
    section = rivals(diagnosis, evidence)
    assert [row["word"] for row in section.content["rows"]][:3] == ["", "fits as well, costs more", "ruled out"]
    assert section.heading.endswith("the next rival is 14 points worse")


def test_what_holds_the_verdict_and_more_is_no_rival_of_it(fakes: Any) -> None:
    """It fits nearly as well, and was not excluded but needless."""
    diagnosis, evidence = fakes["named"]()
    best, second, *_ = diagnosis["rivals"]
    second["effects"] = [*best["effects"], {"name": "cogging", "target": "joint:elbow"}]
    section = rivals(diagnosis, evidence)
    assert [row["word"] for row in section.content["rows"]][:3] == ["", "more than is needed", "ruled out"]
    assert section.heading.endswith("the next rival is 14 points worse")


def test_where_nothing_is_named_the_next_one_is_told_that_leaves_more() -> None:
    effect = {"name": "cogging", "target": "joint:elbow"}
    scores = [([], 0.0, 1.0), ([effect], 12.0, 0.99), ([effect | {"name": "joint_stop"}], 15.0, 1.1)]
    names = ("effects", "delta_bic", "chi2_per_dof")
    found = [dict(zip(names, each, strict=True)) for each in scores]
    section = rivals({"verdict": "none", "effects": [], "rivals": found}, {})
    assert section is not None
    assert section.heading == "No effect improves on the simulator: the best is 15 points worse"
    assert [row["word"] for row in section.content["rows"]] == ["", "fits as well, costs more", "ruled out"]


def test_all_that_tie_are_marked(fakes: Any) -> None:
    assert [row["tag"] for row in rivals(*fakes["tie"]()).content["rows"]] == ["tied", "tied", "", ""]


@pytest.mark.parametrize(("gap", "word"), [(284.0, "not told apart here"), (4.0, "less likely")])
def test_a_law_by_another_name_is_not_ruled_out_by_what_its_name_costs(gap: float, word: str) -> None:
    def effect(name: str, *ties: str) -> dict[str, Any]:
        target = {"target": "joint:elbow"}
        return {"name": name, **target, "ties": [{"name": tie, **target} for tie in ties]}

    dry, push, two = effect("coulomb_friction", "asymmetric_friction"), effect("constant_force"), "asymmetric_friction"
    sets = [[dry, push], [effect(two)], [effect(two), effect("cogging")], [push], []]
    found = [{"effects": effects, "delta_bic": 300.0 * i} for i, effects in enumerate(sets)]
    found[1]["delta_bic"] = gap
    rows = rivals({"verdict": "tie", "effects": [dry], "rivals": found}, {}).content["rows"]
    assert [row["tag"] for row in rows] == ["tied", "tied", "", "", ""]
    assert [row["word"] for row in rows] == ["", word, *["ruled out"] * 3]


def test_a_rival_behind_by_rounding_alone_is_as_good_as_the_best() -> None:
    effects = [[{"name": name, "target": "joint:elbow"}] for name in ("constant_force", "linear_spring", "cogging")]
    found = [{"effects": some, "delta_bic": gap} for some, gap in zip(effects, (0.0, 6e-12, 0.5), strict=True)]
    rows = rivals({"verdict": "tie", "effects": effects[0], "rivals": found}, {}).content["rows"]
    assert [row["gap"] for row in rows] == ["best", "best", "0.5"]


def test_the_many_rivals_go_behind_a_fold(fakes: Any) -> None:
    diagnosis, evidence = fakes["named"]()
    content = rivals(diagnosis | {"rivals": diagnosis["rivals"] * 2}, evidence).content
    assert (len(content["rows"]), len(content["more"])) == (8, 4)


def test_little_is_said_of_little() -> None:
    assert rivals({"verdict": "named"}, {}) is None
    section = rivals({"verdict": "named", "rivals": [{"effects": []}]}, {})
    assert (section.heading, section.content["rows"][0]["gap"]) == ("The explanations compared", "\u2013")


def test_a_long_rival_that_holds_the_best_set_is_told_by_what_it_adds() -> None:
    a, b, c, d = ({"name": "cogging", "target": f"joint:{name}"} for name in "abcd")

    def names(*sets: list[Any]) -> list[str]:
        found = [{"effects": effects, "delta_bic": float(gap)} for gap, effects in enumerate(sets)]
        return [row["name"] for row in rivals({"verdict": "named", "effects": [], "rivals": found}, {}).content["rows"]]

    assert names([a, b], [c, b, a], [a], [a, c, d], [a, b]) == [
        "Cogging at joint a and cogging at joint b",
        "The same and cogging at joint c",
        "Cogging at joint a",
        "Cogging at joint a, cogging at joint c and cogging at joint d",
        "Cogging at joint a and cogging at joint b",
    ]
    assert names([a], [a, b], [a, b, c])[1:] == [
        "Cogging at joint a and cogging at joint b",
        "The same, cogging at joint b and cogging at joint c",
    ]
    assert names([a, b, c], [c, b, a])[1] == "Cogging at joint c, cogging at joint b and cogging at joint a"
    assert names([], [a, b, c])[1] == "Cogging at joint a, cogging at joint b and cogging at joint c"


def test_what_is_fitted_along_stands_apart() -> None:
    dry, push, *tuned = ({"name": "cogging", "target": f"joint:{name}"} for name in "pqabcd")

    def rows(along: list[Any], *sets: list[Any]) -> list[tuple[str, str, str]]:
        found = [{"effects": effects, "delta_bic": 20.0 * gap} for gap, effects in enumerate(sets)]
        section = rivals({"verdict": "named", "effects": [dry], "retuned": along, "rivals": found}, {})
        assert section.heading == "Cogging at joint p: the next rival is 20 points worse"
        return [(row["name"], row["along"], row["tag"]) for row in section.content["rows"]]

    a, *others = tuned
    assert rows(tuned, [dry, *tuned], [push, *tuned], [push, *others], [push, a], [*tuned], [dry, push, *tuned]) == [
        ("Cogging at joint p", "with 4 fitted along", "the verdict"),
        ("Cogging at joint q", "with 4 fitted along", ""),
        ("Cogging at joint q", "with 3 fitted along, without cogging at joint a", ""),
        ("Cogging at joint q", "with cogging at joint a", ""),
        ("Cogging at joint a, cogging at joint b, cogging at joint c and cogging at joint d", "", ""),
        ("The same and cogging at joint q", "", ""),
    ]
    assert rows([a], [dry, a], [push, a])[0] == ("Cogging at joint p", "with cogging at joint a", "the verdict")
