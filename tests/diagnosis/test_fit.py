from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.fit import difference_steps


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
