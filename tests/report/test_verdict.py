from __future__ import annotations

from typing import Any

import pytest

from torch_activegp.errors import DataError
from torch_activegp.report.verdict import BADGES, banner


@pytest.mark.parametrize(
    ("verdict", "sure"),
    [
        ("none", "Noise alone leaves at least this much in 43 % of all repeats."),
        ("named", "Very likely: for the least sure effect, 96 % probability against every rival tried."),
        ("tie", "which of the tied effects causes it, these recordings do not tell."),
        ("unknown", "abstaining is the honest answer."),
    ],
)
def test_how_sure(fakes: Any, verdict: str, sure: str) -> None:
    top = banner(fakes[verdict]()[0])
    assert sure in top["sure"].replace("\u00a0", " ")
    assert (top["badge"], top["symbol"]) == BADGES[verdict]


def test_key_figures(fakes: Any) -> None:
    top = banner(fakes["named"]()[0])
    values = [figure["value"].replace("\u00a0", " ") for figure in top["figures"]]
    assert values == ["8.13", "98 %", "240 % \u2192 0.2 %"]
    assert top["subject"] == "Simulator arm.xml \u00b7 6 runs fitted (28.8 s) \u00b7 2 runs held out (9.6 s)"


def test_where_a_run_cannot_be_forecast_freely_the_figure_is_the_error_by_one_step(fakes: Any) -> None:
    diagnosis, _ = fakes["named"]()
    diagnosis["fit"]["holdout"] |= {"one_step": {"before": 0.2, "after": 0.1}, "runs": [{"predictable": False}]}
    (figure,) = banner(diagnosis)["figures"][2:]
    assert figure["label"] == "one-step error, held-out runs"
    assert figure["value"].replace("\u00a0", " ") == "20 % \u2192 10 %"


@pytest.mark.parametrize(
    ("chance", "left", "said"),
    [
        (0.3, 1.0, "Noise alone leaves"),
        (1e-6, 1.1, "A little more is left than white noise"),
        (1e-6, 4.2, "More is left than the rows show of noise"),
    ],
)
def test_a_control_in_which_something_is_left_does_not_call_it_noise(
    fakes: Any, chance: float, left: float, said: str
) -> None:
    diagnosis, _ = fakes["none"]()
    diagnosis["mismatch"]["p_value"], diagnosis["unexplained"] = chance, {"chi2_per_dof": left}
    assert banner(diagnosis)["sure"].startswith(said)


def test_without_a_correction_there_is_one_error(fakes: Any) -> None:
    values = [figure["value"] for figure in banner(fakes["none"]()[0])["figures"]]
    assert values == ["1.003", "0.2\u00a0%"]


def test_little_is_said_of_little() -> None:
    assert banner({"verdict": "named"})["sure"] == "The mismatch is real."
    assert banner({"verdict": "none"}) | {"sentence": ""} == {
        "verdict": "none", "sentence": "", "more": "", "badge": "No mismatch found", "symbol": "\u2713", "sure": "",
        "figures": [], "subject": "",
    }  # fmt: skip


def test_a_wrong_verdict_is_refused() -> None:
    with pytest.raises(DataError, match="found None"):
        banner({})


def test_the_error_with_a_learned_force_comes_last(fakes: Any) -> None:
    diagnosis, _ = fakes["unknown"]()
    diagnosis["fit"]["holdout"]["free_run"] |= {"before": 0.31, "after": 0.31, "gp": 0.03}
    diagnosis["effects"] = []
    figure = banner(diagnosis)["figures"][-1]
    assert figure["value"].replace("\u00a0", " ") == "31 % \u2192 3 %"
    assert "the last with a learned force" in figure["note"]


def test_the_first_sentence_is_the_heading() -> None:
    text = "They differ (noise 0.2). Check `ctrl.a` first: it is 2.5 times too large. Mend it."
    found = banner({"verdict": "unknown", "sentence": text})
    assert found["sentence"] == "They differ (noise 0.2)."
    assert found["more"] == "Check `ctrl.a` first: it is 2.5 times too large. Mend it."
