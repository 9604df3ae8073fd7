from __future__ import annotations

import json

import pandas as pd
import pytest

from torch_activegp.experiments.claims import Claim, check_claims, claims_as_dicts, claims_as_markdown

Values = dict[str, tuple[float, float, float]]


def table(values: Values, trials: int = 5, episodes: int = 3, spread: float = 0.0) -> pd.DataFrame:
    """Mean squared error, variance and discrepancy of each method; the trials lie ``spread`` apart around them."""
    rows = [
        (method, trial, episode, *(value * (1 + spread * (trial - (trials - 1) / 2)) for value in triple))
        for method, triple in values.items()
        for trial in range(trials)
        for episode in range(1, episodes + 1)
    ]
    return pd.DataFrame(rows, columns=["method", "trial", "episode", "mse", "max_variance", "discrepancy"])


HELD: Values = {"discrepancy": (0.1, 0.5, 0.3), "opax": (10.0, 0.48, 0.2), "sigma": (0.1, 0.4, 0.25)}


def verdicts(values: Values, **options: float) -> list[str]:
    return [claim.verdict for claim in check_claims(table(values, **options))]


def test_all_four_can_hold_and_all_four_can_fail() -> None:
    assert verdicts(HELD) == ["held"] * 4
    failed = {"discrepancy": (1.1, 0.5, 0.2), "opax": (10.0, 0.4, 0.21), "sigma": (0.1, 0.45, 0.1)}
    assert verdicts(failed) == ["not held"] * 4


def test_the_thresholds_are_those_of_the_text() -> None:
    assert verdicts({**HELD, "discrepancy": (0.99, 0.527, 0.3)})[:2] == ["held", "held"]
    assert verdicts({**HELD, "discrepancy": (1.01, 0.529, 0.3)})[:2] == ["not held", "not held"]
    first, second, *_ = check_claims(table(HELD))
    assert "at most 1/10" in first.text
    assert "within 10%" in second.text


def test_one_baseline_that_is_better_is_enough_to_fail() -> None:
    assert verdicts({**HELD, "sigma": (0.1, 0.4, 0.31)})[3] == "not held"
    assert verdicts({**HELD, "opax": (10.0, 0.3, 0.2)})[2] == "not held"


def test_ties_are_not_verdicts() -> None:
    early = {"discrepancy": (0.1, 1.0, 0.3), "opax": (10.0, 0.9999999, 0.3), "sigma": (0.1, 1.0, 0.3)}
    assert verdicts(early) == ["held", *["not distinguishable yet"] * 3]
    later = {**early, "discrepancy": (0.1, 0.5, 0.3), "opax": (10, 0.5, 0.2), "sigma": (0.1, 0.49999, 0.30001)}
    assert verdicts(later) == ["held", "held", "not distinguishable yet", "not distinguishable yet"]


def test_few_trials_and_overlapping_ones_are_no_verdict() -> None:
    assert verdicts(HELD, trials=4)[2:] == ["not distinguishable yet"] * 2
    frame = table({**HELD, "sigma": (0.1, 0.49, 0.29)})
    noise = frame["trial"].map({0: -0.1, 1: 0.1, 2: 0.0, 3: 0.05, 4: -0.05})
    frame.loc[frame["method"] == "discrepancy", ["max_variance", "discrepancy"]] += noise.to_frame().to_numpy()[
        frame["method"] == "discrepancy"
    ]
    assert [claim.verdict for claim in check_claims(frame)][2:] == ["not held", "not distinguishable yet"]


def test_only_the_first_and_the_last_episode_count_where_the_claim_says_so() -> None:
    frame = table(HELD)
    middle = frame["episode"] == 2
    frame.loc[middle, ["mse", "max_variance"]] *= 100
    assert [claim.verdict for claim in check_claims(frame)] == ["held"] * 4
    frame.loc[middle & (frame["method"] == "opax"), "discrepancy"] = 5.0
    assert check_claims(frame)[3].verdict == "not held"


def test_what_was_seen_is_mean_min_max_and_how_often() -> None:
    claims = check_claims(table(HELD, trials=3, spread=0.1))
    assert claims[0].seen == "MSE 0.1 [0.09, 0.11] against 10 [9, 11]: 100 times lower"
    assert claims[3].seen == (
        "discrepancy 0.3 [0.27, 0.33]; opax 0.2 [0.18, 0.22]; sigma 0.25 [0.225, 0.275]; highest in 3 of 3 trials"
    )
    assert claims[2].seen.endswith("lowest in 3 of 3 trials")


@pytest.mark.parametrize(
    ("methods", "count"), [(("sigma",), 0), (("discrepancy", "sigma"), 0), (("discrepancy", "opax"), 2)]
)
def test_a_claim_needs_its_methods(methods: tuple[str, ...], count: int) -> None:
    assert len(check_claims(table({name: HELD[name] for name in methods}))) == count


def test_markdown_and_json() -> None:
    claims = check_claims(table(HELD))
    text = claims_as_markdown(claims, "pendulum")
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert len(rows) == 6
    assert {line.count(" | ") for line in rows if "---" not in line} == {2}
    assert "\\|p0 - f\\|" in text
    assert "# The paper's claims on pendulum" in text
    assert Claim(**json.loads(json.dumps(claims_as_dicts(claims)))[0]) == claims[0]
    assert "not all run" in claims_as_markdown([], "pendulum")
