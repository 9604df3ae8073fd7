from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.fit import difference_steps, inside


def test_a_fit_says_what_to_simulate(bench) -> None:
    effects = (bench.effect("viscous_friction"), bench.effect("hysteresis"))
    values = (np.array([0.1]), np.array([2.0, 0.3]))
    fit = dataclasses.replace(bench.nominal, effects=effects, values=values)
    assert fit.candidate.effects == effects
    assert fit.candidate.values == values
    assert fit.candidate.force is None
    assert fit.size == 3
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
    assert found[0] == below.chi2
    assert found[1].tolist() == [0.0, below.values[0][0]]
    np.testing.assert_array_equal(found[2], below.starts)
    assert inside((wet, late), (guess, guess), below) is None
    assert inside((drag,), (guess,), below) is None
    assert inside((wet,), (guess,), below) is None
    assert inside((wet,), (guess,), None) is None
