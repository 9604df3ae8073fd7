from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.stepwise import one_by_one
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.score import Score

NAMES = ("viscous_friction", "coulomb_friction", "quadratic_drag", "hysteresis", "linear_spring")


class Steps:
    """Sets whose chi2 is said, in parts of what the nominal leaves above the noise; developing one brings the next."""

    def __init__(self, bench, left: dict[str, float], cut_short: bool = False) -> None:
        self.bench, self.left, self.seen = bench, left, list[str]()
        wide = dataclasses.replace(bench.nominal, chi2=3.0 * bench.shooting.dof)
        self.nominal = wide
        self.selection = Selection(wide, [wide], Score(bench.shooting.samples, 60, 1.0), cut_short=cut_short)
        for letters in {"h" if "h" in left else "vch", "vch" if "vch" in left else "h"}:
            self.add(letters)

    def fit(self, letters: str) -> Fit:
        effects = tuple(self.bench.effect(next(n for n in NAMES if n[0] == letter)) for letter in letters)
        values = tuple(np.full(len(effect.parameters), 0.1) for effect in effects)
        chi2 = self.bench.shooting.dof * (1.0 + 2.0 * self.left[letters])
        return dataclasses.replace(self.nominal, effects=effects, values=values, chi2=chi2)

    def add(self, letters: str) -> None:
        self.selection.add([self.fit(letters)])

    def develop(self, fit: Fit) -> None:
        letters = "".join(effect.name[0] for effect in fit.effects)
        self.seen.append(letters)
        for more in (each for each in self.left if len(each) == len(letters) + 1 and set(letters) < set(each)):
            self.add(more)

    def go(self, done: tuple[str, ...] = (), least: int = 1, most: int = 9, singles: bool = True) -> bool:
        for letters in self.left:
            if singles and len(letters) == 1:
                self.add(letters)
        self.selection.developed |= {frozenset(self.fit(letters).effects) for letters in done}

        def may_go_on(fit: Fit) -> bool:
            return len(fit.effects) <= most

        return one_by_one(self.selection, self.bench.shooting, self.develop, may_go_on, least)


TRUE = {"v": 0.3, "c": 0.4, "h": 0.35, "vc": 0.2, "vcq": 0.0, "vch": 0.15}


def test_each_name_comes_on_top_of_the_best_so_far(bench) -> None:
    steps = Steps(bench, TRUE)
    assert steps.go()
    assert steps.seen == ["v", "vc", "vcq"]
    assert [effect.name[0] for effect in steps.selection.best.effects] == ["v", "c", "q"]


@pytest.mark.parametrize(("done", "first"), [((), ["", "v"]), (("",), [])])
def test_without_single_names_they_are_fitted_first(bench, done, first) -> None:
    """Where a search began from three that came from less of the data."""
    steps = Steps(bench, {"": 1.0} | {key: left for key, left in TRUE.items() if key != "h"})
    assert steps.go(done=done, singles=False) is bool(first)
    assert steps.seen[:2] == first


def test_what_was_developed_is_not_again(bench) -> None:
    steps = Steps(bench, {**TRUE, "vl": 0.25})
    steps.add("vc")
    assert steps.go(done=("v",))
    assert steps.seen == ["vc", "vcq"]


def test_it_ends_where_a_set_may_not_be_developed(bench) -> None:
    steps = Steps(bench, TRUE)
    assert not steps.go(most=1)
    assert steps.seen == ["v"]


def test_it_ends_where_one_more_gains_nothing(bench) -> None:
    steps = Steps(bench, {"v": 0.3, "h": 0.35, "vc": 0.3, "vch": 0.2})
    assert not steps.go()
    assert steps.seen == ["v"]


@pytest.mark.parametrize(
    ("left", "options"),
    [
        ({**TRUE, "vch": 0.02}, {}),  # noise alone
        ({**TRUE, "v": 0.9, "c": 0.9, "h": 0.9, "vch": 0.8}, {}),  # nearly all
        (TRUE, {"least": 4}),
    ],
)
def test_nothing_is_done_where_it_leads_nowhere(bench, left, options) -> None:
    steps = Steps(bench, left)
    assert not steps.go(**options)
    assert steps.seen == []


def test_nothing_is_done_behind_a_search_that_was_cut_short(bench) -> None:
    steps = Steps(bench, TRUE, cut_short=True)
    assert not steps.go()
    assert steps.seen == []
