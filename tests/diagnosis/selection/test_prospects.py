from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.prospects import cannot_win, hopeless, is_alike, leaves_most
from torch_activegp.diagnosis.shooting.score import Score


@pytest.mark.parametrize(
    ("free", "others", "developed"),
    [
        (True, ("constant_force",), True),  # another push beside the same name: both undo a tuning
        (True, (), False),  # nothing is undone here
        (False, ("constant_force",), False),  # both are names
        (True, ("constant_force", "quadratic_drag"), False),  # one more name
    ],
)
def test_sets_with_the_same_names_that_undo_a_tuning_in_other_ways_are_developed_once(
    bench, free, others, developed
) -> None:
    def of(*names: str, chi2: float):
        effects = tuple(bench.effect(*name.split("@")) for name in names)
        return dataclasses.replace(bench.nominal, effects=effects, values=(np.array([0.1]),) * len(names), chi2=chi2)

    tunable = frozenset(effect.key for effect in bench.effects if effect.tunable) if free else frozenset()
    best = of("coulomb_friction", "actuator_bias@actuator:drive", chi2=2000.0)
    fit = of("coulomb_friction", *others, chi2=2100.0)
    score = Score(bench.shooting.samples, 60, 5.0, free=tunable)
    chosen = Selection(bench.nominal, [bench.nominal, best, fit], score)
    assert chosen.best is best
    assert is_alike(chosen, fit, {frozenset(best.effects)}) == developed
    assert not is_alike(chosen, fit, set())
    assert not is_alike(chosen, best, {frozenset(fit.effects)})
    close = dataclasses.replace(fit, chi2=best.chi2 + 50.0)
    assert score.cheapest * score.scale == pytest.approx(75.0, abs=15.0)
    near = Selection(bench.nominal, [bench.nominal, best, close], score)
    assert is_alike(near, best, {frozenset(close.effects)}) == developed


@pytest.mark.parametrize(
    ("left", "developed", "more", "lost"),
    [
        (1.0, True, True, True),
        (1.2, True, True, False),  # something else is missing
        (1.0, False, True, False),  # nothing was tried on top of the best set yet
        (1.0, True, False, False),  # it costs no more than that
    ],
)
def test_a_dearer_set_cannot_win_once_the_best_one_leaves_noise_and_was_developed(
    bench, left: float, developed: bool, more: bool, lost: bool
) -> None:
    dry, push = bench.effect("coulomb_friction"), bench.effect("constant_force")
    values = {"values": (np.array([0.1]),), "chi2": 2000.0}
    best = dataclasses.replace(bench.nominal, effects=(dry,), **values)
    other = dataclasses.replace(bench.nominal, effects=(push,), values=(np.array([0.1]),), chi2=2100.0)
    if more:
        other = dataclasses.replace(other, effects=(dry, push), values=(np.array([0.1]),) * 2)
    found = Selection(bench.nominal, [bench.nominal, best, other], Score(bench.shooting.samples, 60, left))
    found.developed = {frozenset(best.effects)} if developed else set()
    assert cannot_win(found, other) is lost


@pytest.mark.parametrize(
    ("there", "left", "names", "lost"),
    [
        (1.0, 0.6, 1, True),
        (1.0, 0.4, 1, False),  # the names explain the larger part
        (0.1, 0.08, 1, False),  # hardly anything is missing
        (1.0, 0.6, 0, False),  # nothing was named
    ],
)
def test_names_that_leave_most_of_a_large_mismatch_are_hopeless(
    bench, there: float, left: float, names: int, lost: bool
) -> None:
    """`there` and `left` are above the noise, in units of it."""
    dof = bench.shooting.dof
    nominal = dataclasses.replace(bench.nominal, chi2=(1.0 + there) * dof)
    effects = (bench.effect("coulomb_friction"),) * names
    best = dataclasses.replace(nominal, effects=effects, values=(np.array([0.1]),) * names, chi2=(1.0 + left) * dof)
    found = Selection(nominal, [best], Score(bench.shooting.samples, 60, 1.0))
    assert hopeless(found, bench.shooting) is lost
    assert not hopeless(found, bench.shooting, least=2)
    assert leaves_most(found, bench.shooting) is (left > 0.5 * there)
