from __future__ import annotations

import pytest

from torch_activegp.report.words import (
    belief,
    bic_word,
    capital,
    counted,
    effect_text,
    effects_text,
    explained,
    listed,
    place_name,
    telling,
)

COULOMB = {"name": "coulomb_friction", "target": "joint:elbow", "share": 0.91}
GAIN = {"name": "actuator_gain", "target": "actuator:m1", "share": 0.07}
WIND = {"name": "constant_force", "target": "world"}


def test_effects_in_words() -> None:
    assert effect_text(COULOMB) == "Coulomb friction at joint elbow"
    assert effect_text(WIND) == "constant force"
    assert effects_text([COULOMB, GAIN]) == "Coulomb friction at joint elbow and actuator gain at actuator m1"
    assert effects_text([]) == "the simulator as it is"
    assert place_name("body:my:arm") == "body my:arm"


@pytest.mark.parametrize(
    ("runs", "kind"),
    [(None, "free_run"), ([{}, {"predictable": True}], "free_run"), ([{"predictable": False}, {}], "one_step")],
)
def test_errors_of_free_runs_tell_where_all_can_be_forecast(runs: list | None, kind: str) -> None:
    assert telling({"runs": runs}) == kind


def test_lists_and_counts() -> None:
    assert [listed("abc"[:count]) for count in range(4)] == ["", "a", "a and b", "a, b and c"]
    assert listed("ab", "or") == "a or b"
    assert (counted(1, "run"), counted(0, "run")) == ("1 run", "0 runs")
    assert capital("the Hopper") == "The Hopper"


@pytest.mark.parametrize(("probability", "word"), [(0.995, "Near certain"), (0.96, "Very likely"), (0.3, "A guess")])
def test_belief(probability: float, word: str) -> None:
    assert belief(probability) == word


@pytest.mark.parametrize(
    ("difference", "word"), [(0.3, "as good"), (2.0, "less likely"), (7.0, "hardly possible"), (11, "ruled out")]
)
def test_bic_words(difference: float, word: str) -> None:
    assert bic_word(difference) == word


def test_shares_add_up_to_one_at_most() -> None:
    assert explained([COULOMB, GAIN]) == pytest.approx(0.98)
    assert explained([COULOMB, COULOMB, WIND]) == 1.0
