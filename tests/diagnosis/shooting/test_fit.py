from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.shooting.fit import difference_steps, inside, resting
from torch_activegp.diagnosis.shooting.point import FAILED


def test_a_fit_says_what_to_simulate(bench) -> None:
    effects = (bench.effect("viscous_friction"), bench.effect("hysteresis"))
    values = (np.array([0.1]), np.array([2.0, 0.3]))
    fit = dataclasses.replace(bench.nominal, effects=effects, values=values)
    assert fit.candidate.effects == effects
    assert fit.candidate.values == values
    assert fit.candidate.force is None
    assert fit.size == 3
    assert not fit.is_known  # its information is the nominal's, of no parameter
    known = dataclasses.replace(fit, information=np.eye(3))
    assert known.is_known
    assert not dataclasses.replace(known, at_rest=True).is_known
    assert fit.places == {effects[0]: slice(0, 1), effects[1]: slice(1, 3)}
    assert fit.keys == {("viscous_friction", "joint:hip"), ("hysteresis", "joint:hip")}
    parameters = [parameter for effect in effects for parameter in effect.parameters]
    own = [p.step(v) for p, v in zip(parameters, np.concatenate(values), strict=True)]
    np.testing.assert_array_equal(difference_steps(effects, np.concatenate(values)), own)


def test_the_nominal_has_nothing(bench) -> None:
    assert (bench.nominal.size, bench.nominal.keys, bench.nominal.candidate.effects) == (0, frozenset(), ())
    assert difference_steps((), np.zeros(0)).shape == (0,)


def test_a_set_holds_a_smaller_one_and_linear_effects_that_do_nothing(bench) -> None:
    below = bench.fit("viscous_friction", 0.05)
    drag, wet, late = bench.effect("quadratic_drag"), below.effects[0], bench.effect("actuator_delay", "actuator:drive")
    guess = np.array([0.4])
    found = inside((drag, wet), (guess, guess), below)
    assert found is not None
    assert found[0] is below
    assert found[1].tolist() == [0.0, below.values[0][0]]
    assert inside((wet, late), (guess, guess), below) is None
    assert inside((drag,), (guess,), below) is None
    assert inside((wet,), (guess,), below) is None
    assert inside((wet,), (guess,), None) is None
    still = resting((drag, wet), found[1], below)
    assert (still.chi2, still.size, still.information.any()) == (below.chi2, 2, False)
    np.testing.assert_array_equal(bench.shooting.residual_of(still), bench.shooting.residual_of(below))


def test_derivatives_are_lent_to_the_same_parameters_elsewhere(bench) -> None:
    wet, drag = bench.effect("viscous_friction"), bench.effect("quadratic_drag")
    columns = np.arange(8.0 * 59 * 2).reshape(8, 59, 2)
    fit = dataclasses.replace(
        bench.nominal,
        effects=(wet, drag),
        values=(np.array([0.1]), np.array([5.0])),
        columns=columns,
        taken=np.array([0.1, 0.31]),
    )
    lent = fit.columns_of((bench.effect("hysteresis"), drag, wet), (np.ones(2), np.array([0.3]), np.array([0.2])))
    assert list(lent) == [2]
    np.testing.assert_array_equal(lent[2], columns[..., 1])
    stop = bench.effect("hysteresis")
    shaped = dataclasses.replace(fit, effects=(stop,), values=(np.ones(2),), taken=np.array([2.0, 0.3]))
    assert set(shaped.columns_of((wet, stop), (np.ones(1), np.array([2.1, 0.301])))) == {1, 2}
    assert shaped.columns_of((stop,), (np.array([2.1, 0.31]),)) == {}
    assert bench.nominal.columns_of((drag,), (np.ones(1),)) == {}
    np.testing.assert_array_equal(fit.pick(np.array([1, 4])).columns, columns[[1, 4]])
    assert dataclasses.replace(fit, columns=None).columns_of((wet,), (np.array([0.1]),)) == {}


def test_a_part_of_a_fit_whose_simulation_failed_has_failed_or_not(bench) -> None:
    per_segment = bench.nominal.per_segment.copy()
    per_segment[1] = FAILED
    failed = dataclasses.replace(bench.nominal, per_segment=per_segment, chi2=np.inf)
    assert failed.pick(np.array([0, 1])).chi2 == np.inf
    assert failed.pick(np.array([0, 2])).chi2 == per_segment[[0, 2]].sum()


def test_some_segments_begin_elsewhere(bench) -> None:
    which, before = np.array([1, 3]), bench.nominal.starts.copy()
    other = bench.nominal.beginning(which, before[which] + 1.0)
    assert np.flatnonzero((other.starts != before).any(axis=1)).tolist() == [1, 3]
    np.testing.assert_array_equal(bench.nominal.starts, before)
