from __future__ import annotations

import dataclasses

import pytest

from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.outdone import leave_out_outdone, outdone_by
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.inertia import GravityError


@pytest.fixture
def pair(bench):
    """Gravity along two axes, and a spring with a rest that leaves 100 less and has a higher price."""
    gravity = GravityError.along(0, 2)
    spring = next(e for e in bench.effects if e.key == ("linear_spring", "joint:hip") and len(e.parameters) == 2)
    sets = [dataclasses.replace(bench.nominal, effects=(e,), values=(e.seeds[0],)) for e in (gravity, spring)]
    return [dataclasses.replace(fit, chi2=chi2) for fit, chi2 in zip(sets, (5100.0, 5000.0), strict=True)]


def among(bench, *fits):
    nominal = dataclasses.replace(bench.nominal, chi2=1e5)
    return Selection(nominal, [nominal, *fits], Score(5000, 60, 1.0, mismatch=1e5))


def test_of_sets_with_as_many_names_and_parameters_the_one_that_leaves_less_comes_first(bench, pair) -> None:
    vector, law = pair
    chosen = among(bench, vector, law)
    assert chosen.best is vector
    assert outdone_by(chosen, vector) is law
    assert leave_out_outdone(chosen)
    assert chosen.best is law
    assert vector not in chosen.fits
    assert not leave_out_outdone(chosen)


def test_a_set_is_not_outdone_by_one_with_more_names_or_parameters_or_hardly_less_chi2(bench, pair) -> None:
    vector, law = pair
    push = bench.effect("constant_force")
    other = dataclasses.replace(law, effects=(push, bench.effect("viscous_friction")), values=(law.values[0][:1],) * 2)
    longer = dataclasses.replace(law, values=((0.0, 0.0, 0.0),))
    near = dataclasses.replace(law, chi2=vector.chi2 - 15.0)
    still = dataclasses.replace(law, at_rest=True)
    for fit in (other, longer, near, still):
        chosen = among(bench, vector, fit)
        assert outdone_by(chosen, vector) is None
        assert not leave_out_outdone(chosen)
        assert fit in chosen.fits
