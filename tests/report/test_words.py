from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.report.words import (
    belief,
    bic_word,
    capital,
    counted,
    effect_text,
    effects_text,
    excess,
    explained,
    listed,
    own_sentence,
    place_name,
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


@pytest.mark.parametrize(
    ("verdict", "effects", "sentence"),
    [
        ("none", [], "The simulator agrees with the recordings: what is left looks like measurement noise."),
        ("named", [COULOMB], "Coulomb friction at joint elbow explains 91 % of the mismatch."),
        (
            "named",
            [WIND | {"share": 0.6}, COULOMB],
            "Constant force and Coulomb friction at joint elbow explain 100 % of the mismatch.",
        ),
        (
            "tie",
            [GAIN | {"ties": [WIND]}],
            "Actuator gain at actuator m1 or constant force: these recordings cannot separate them.",
        ),
        ("unknown", [], "The simulator is wrong, and no effect that we know explains it."),
        (
            "unknown",
            [WIND],
            "The simulator is wrong, and no effect that we know explains it. Only constant force could be named.",
        ),
    ],
)
def test_own_sentence(verdict: str, effects: list[Any], sentence: str) -> None:
    assert own_sentence({"verdict": verdict, "effects": effects}).replace("\u00a0", " ") == sentence


def test_what_the_simulator_has_too_much_of_is_said() -> None:
    diagnosis = {"verdict": "named", "effects": [COULOMB | {"too_much": True}, GAIN | {"too_much": False}]}
    assert own_sentence(diagnosis).endswith(
        " of the mismatch. The simulator has too much Coulomb friction at joint elbow."
    )
    assert excess([COULOMB]) == ""


def test_shares_add_up_to_one_at_most() -> None:
    assert explained([COULOMB, GAIN]) == pytest.approx(0.98)
    assert explained([COULOMB, COULOMB, WIND]) == 1.0
