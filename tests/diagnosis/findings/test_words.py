from __future__ import annotations

import pytest

from torch_activegp.diagnosis.findings.words import sentence
from torch_activegp.diagnosis.result import Estimate, NamedEffect

CALM = [{"predictable": True}]
LEFT = {"share": 0.05, "white": True, "chi2_per_dof": 1.0}
STEP = {"before": 0.09, "after": 0.009, "noise": 0.0085}
ERROR = {
    "fit": {"holdout": {"free_run": {"before": 0.1234, "after": 0.01, "noise": 0.009}, "one_step": STEP, "runs": CALM}},
    "location": [],
    "unexplained": LEFT,
}


def named(name: str, share: float, ties: tuple[tuple[str, str], ...] = ()) -> NamedEffect:
    return NamedEffect(name, "joint:hip", "law", share, 1.0, {"c": Estimate(1.0, "1", (0.0, 2.0))}, ties)


def test_nothing_found() -> None:
    assert sentence("none", (), ERROR) == "The simulator and the recordings differ by noise alone."


def test_noise_that_may_be_louder_than_it_looks_is_not_called_noise_alone() -> None:
    """As at 50 Hz, where a filter's noise looks four times quieter."""
    words = sentence("none", (), {**ERROR, "unexplained": {**LEFT, "chi2_per_dof": 4.25}})
    assert words.startswith("The simulator and the recordings differ by no more than noise may: by 4.25 times")
    assert words.endswith("Faster recordings would tell.")


def test_what_the_clock_may_have_left_is_no_mismatch() -> None:
    words = sentence("none", (), {**ERROR, "unexplained": {"chi2_per_dof": 2.05}}, rounded=True)
    assert words.endswith(
        "differ by no more than rounding the recorded times may leave: 2.05 times the noise (chi2 per dof)."
    )


@pytest.mark.parametrize(
    ("location", "words"),
    [([], "differ, and no effect"), ([{"target": "joint:hip"}, {"target": "b"}], "most of it at joint:hip, and no")],
)
def test_unknown_says_where(location, words) -> None:
    assert words in sentence("unknown", (), {**ERROR, "location": location})


@pytest.mark.parametrize(
    ("targets", "share", "ending"),
    [
        ((), 1.0, "explains it."),
        (("a",), 0.6, "explains it."),
        (("a",), 0.02, "explains it: drag at a leaves 2.7e+03 times the noise (chi2 per dof)."),
        (("a", "b"), 0.02, "explains it: drag at a and drag at b leave 2.7e+03 times the noise (chi2 per dof)."),
    ],
)
def test_unknown_says_what_came_closest(targets, share, ending) -> None:
    effects = [{"name": "drag", "target": target} for target in targets]
    found = {"rivals": [{"effects": effects, "chi2_per_dof": 2703.0}], "unexplained": {"share": share}}
    assert sentence("unknown", (), {**ERROR, **found}).endswith(ending)


def test_unknown_says_what_a_learned_force_gains() -> None:
    free = {"before": 1.14, "after": 1.14, "gp": 0.1084, "noise": 0.0024}
    text = sentence("unknown", (), {**ERROR, "fit": {"holdout": {"free_run": free, "one_step": STEP, "runs": CALM}}})
    assert text.endswith(
        "explains it; with a force learned from the recordings (learned.pt) the free-run error on held-out runs goes "
        "from 1.14 to 0.108 (noise 0.0024)."
    )


def test_unknown_says_what_a_learned_force_gains_by_one_step_where_free_runs_gain_nothing() -> None:
    held_out = {
        "free_run": {"before": 0.8, "after": 0.8, "gp": 1.4, "noise": 0.76},
        "one_step": {"before": 0.83, "after": 0.83, "gp": 0.71, "noise": 0.7},
        "runs": CALM,
    }
    text = sentence("unknown", (), {**ERROR, "fit": {"holdout": held_out}})
    assert "the one-step error on held-out runs goes from 0.83 to 0.71 (noise 0.7), and the free-run error" in text
    assert text.endswith("from 0.8 to 1.4.")


def test_where_some_runs_cannot_be_forecast_freely_errors_are_those_by_one_step() -> None:
    free = {"before": 44.8, "after": 34.9, "noise": 0.0085}
    for last, words in ((False, "the one-step error on held-out runs falls from 0.09"), (True, "the free-run error")):
        held_out = {"free_run": free, "one_step": STEP, "runs": [{}, {"predictable": last}]}
        assert words in sentence("named", [named("a", 0.9)], {**ERROR, "fit": {"holdout": held_out}})


def test_unknown_says_nothing_of_a_learned_force_that_changes_nothing() -> None:
    free = {"before": 1.141, "after": 1.141, "gp": 1.1405, "noise": 0.0024}
    fit = {"holdout": {"free_run": free, "one_step": free, "runs": CALM}}
    assert sentence("unknown", (), {**ERROR, "fit": fit}).endswith("explains it.")


def test_named_effects_are_listed_with_what_they_explain_together() -> None:
    text = sentence("named", [named("a", 0.5), named("b", 0.2), named("c", 0.1)], ERROR)
    assert text == (
        "The simulator leaves out a at joint:hip (1), b at joint:hip (1) and c at joint:hip (1), explaining 80% of the "
        "mismatch; with them, the free-run error on held-out runs falls from 0.123 to 0.01 (noise 0.009)."
    )


def test_a_tie_names_the_others() -> None:
    text = sentence("tie", [named("a", 0.9, (("b", "joint:hip"), ("c", "world")))], ERROR)
    assert text.endswith("(noise 0.009); the recordings cannot tell it from b at joint:hip or c at world.")


def test_ties_of_several_effects_are_told_apart() -> None:
    effects = [
        named("a", 0.6, (("b", "joint:hip"),)),
        named("c", 0.2),
        named("d", 0.1, (("b", "joint:hip"), ("e", "world"))),
    ]
    text = sentence("tie", effects, ERROR)
    assert text.endswith(
        "cannot tell a at joint:hip from b at joint:hip and d at joint:hip from b at joint:hip or e at world."
    )


def test_an_error_that_grows_is_not_said_to_fall() -> None:
    worse = {
        "fit": {"holdout": {"free_run": {"before": 0.1, "after": 0.2, "noise": 0.009}, "runs": CALM}},
        "unexplained": LEFT,
    }
    assert "rises from 0.1 to 0.2" in sentence("named", [named("a", 0.9)], worse)


def test_an_error_that_hardly_changes_stays() -> None:
    same = {
        "fit": {"holdout": {"free_run": {"before": 0.02251, "after": 0.02253, "noise": 0.009}, "runs": CALM}},
        "unexplained": LEFT,
    }
    assert "held-out runs stays at 0.0225 (noise" in sentence("named", [named("a", 0.9)], same)


@pytest.mark.parametrize(
    ("chi2", "white", "warned"), [(146.0, False, True), (12.3, False, True), (12.3, True, False), (1.1, False, False)]
)
def test_names_that_leave_much_more_than_noise_are_not_all(chi2, white, warned) -> None:
    details = {**ERROR, "unexplained": {"share": 0.05, "white": white, "chi2_per_dof": chi2}}
    text = sentence("named", [named("a", 0.95)], details)
    assert text.endswith("(chi2 per dof).") == warned
    assert (f"; that is not all, for what is left is still {chi2:.2g} times the noise" in text) == warned


def test_what_the_simulator_has_too_much_of_is_not_left_out() -> None:
    lighter = NamedEffect("payload_mass", "body:arm", "m", 0.3, 1.0, {}, too_much=True)
    text = sentence("named", [named("a", 0.5), lighter], ERROR)
    assert text.startswith(
        "The simulator leaves out a at joint:hip (1) and has too much payload_mass at body:arm, explaining 80% of"
    )
    assert sentence("named", [lighter], ERROR).startswith("The simulator has too much payload_mass at body:arm, expl")


@pytest.mark.parametrize(
    ("units", "told"),
    [(["N m"], "(0.313 N m)"), (["N", "1"], "(p0 0.313 N, p1 0.313)"), ([], ""), (["m"] * 4, ", ...)")],
)
def test_how_much_there_is_stands_in_the_sentence(units: list[str], told: str) -> None:
    parameters = {f"p{i}": Estimate(0.31251, unit, (0.0, 1.0)) for i, unit in enumerate(units)}
    effect = NamedEffect("drag", "joint:hip", "law", 0.9, 1.0, parameters)
    text = sentence("named", [effect], ERROR).partition(", explaining")[0]
    assert text.endswith(told) and text.startswith("The simulator leaves out drag at joint:hip")


def test_unknown_says_what_to_doubt() -> None:
    doubts = ("a: no control is recorded.", "b: in degrees?")
    found = {"unexplained": {"share": 0.1}, "rivals": [{"effects": [{"name": "a", "target": "b"}]}]}
    text = sentence("unknown", (), {**ERROR, **found}, doubts)
    assert text.endswith("no effect on the list explains it. Check the recordings first: a: no control is recorded.")
    assert "Check" not in sentence("named", [named("a", 0.9)], ERROR, doubts)


@pytest.mark.parametrize(("value", "told"), [(1.00362, "(1.0036)"), (1.0, "(1)"), (1.013, "(1.01)")])
def test_a_gain_near_one_is_told_from_one(value: float, told: str) -> None:
    effect = NamedEffect("actuator_gain", "actuator:a", "law", 1.0, 1.0, {"gain": Estimate(value, "1", (0.9, 1.1))}, ())
    assert told in sentence("named", [effect], ERROR)


@pytest.mark.parametrize(("before", "shown"), [(0.0095, False), (0.012, True)])
def test_held_out_runs_that_show_nothing_neither_confirm_nor_deny(before: float, shown: bool) -> None:
    """As where a stop is never reached in them."""
    errors = {"free_run": {"before": before, "after": 0.0091, "noise": 0.009}, "one_step": STEP, "runs": CALM}
    words = sentence("named", (named("stop", 1.0),), {**ERROR, "fit": {"holdout": errors}})
    assert ("the held-out runs do not show it" in words) is not shown
    assert ("falls from 0.012 to 0.0091" in words) is shown
    worse = {**ERROR, "fit": {"holdout": {**errors, "free_run": {"before": before, "after": 0.03, "noise": 0.009}}}}
    assert f"rises from {before} to 0.03" in sentence("named", (named("stop", 1.0),), worse)
