from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.refit import refit
from torch_activegp.diagnosis.shooting.point import FAILED


@pytest.fixture(scope="module")
def without_one(bench) -> np.ndarray:
    """The segments that are kept where each of the two runs is left out."""
    return np.stack([bench.segments.run != number for number in (0, 1)])


@pytest.mark.parametrize(
    ("name", "target", "start"),
    [
        ("viscous_friction", "joint:hip", 0.05),
        ("quadratic_drag", "joint:hip", 0.02),
        ("constant_force", "joint:hip", 0.02),
        ("actuator_gain", "actuator:drive", 0.01),
    ],
)
def test_a_refit_is_the_fit_to_that_part_alone(bench, without_one, name, target, start) -> None:
    """Also for laws that are not the true one, whose best values differ by many standard errors from run to run."""
    effect = bench.effect(name, target)
    fit = bench.shooting.fit([((effect,), (np.array([start]),))], bench.nominal.starts)[0]
    found = refit(bench.shooting, fit, without_one)
    for values, per_segment, kept in zip(found.values, found.per_segment, without_one, strict=True):
        part = bench.shooting.pick(kept)
        wanted = part.fit([(fit.effects, fit.values)], fit.starts[kept])[0]
        assert abs(values[0] - wanted.values[0][0]) < 0.15 / np.sqrt(wanted.information[0, 0])
        assert per_segment[kept].sum() == pytest.approx(wanted.chi2, abs=0.2)
        forecast = bench.shooting.pick(~kept).fit([(fit.effects, wanted.values)], fit.starts[~kept], hold=True)[0]
        assert per_segment[~kept].sum() == pytest.approx(forecast.chi2, abs=0.2, rel=5e-4)


def test_a_law_with_a_kink_is_fitted_about_as_well(bench, without_one) -> None:
    fit = bench.fit("coulomb_friction", 0.05)
    found = refit(bench.shooting, fit, without_one)
    for per_segment, kept in zip(found.per_segment, without_one, strict=True):
        wanted = bench.shooting.pick(kept).fit([(fit.effects, fit.values)], fit.starts[kept])[0]
        assert per_segment[kept].sum() < wanted.chi2 + 2.0
        assert per_segment[kept].sum() < fit.per_segment[kept].sum() - 10.0


def test_a_fit_that_brings_no_derivatives_will_do(bench, without_one) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    again = refit(bench.shooting, dataclasses.replace(fit, design=None), without_one)
    np.testing.assert_allclose(again.values, refit(bench.shooting, fit, without_one).values, rtol=1e-3)


def test_a_part_without_data_leaves_the_parameters_alone(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    nothing = np.zeros((1, bench.segments.size), dtype=bool)
    np.testing.assert_array_equal(refit(bench.shooting, fit, nothing).values[0], fit.values[0])


def test_a_parameter_stays_within_its_bounds(bench, without_one) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    (effect,) = fit.effects
    (parameter,) = effect.parameters
    tight = dataclasses.replace(effect, parameters=(dataclasses.replace(parameter, high=float(fit.values[0][0])),))
    values = refit(bench.shooting, dataclasses.replace(fit, effects=(tight,)), without_one).values
    free = refit(bench.shooting, fit, without_one).values
    assert free.max() > fit.values[0][0]
    assert values.max() <= fit.values[0][0]


def test_the_nominal_has_nothing_to_fit(bench, without_one) -> None:
    found = refit(bench.shooting, bench.nominal, without_one)
    assert found.values.shape == (2, 0)
    np.testing.assert_array_equal(found.per_segment, np.tile(bench.nominal.per_segment, (2, 1)))


def test_where_every_trial_fails_the_values_stay(bench, without_one, monkeypatch) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    predict, calls = bench.engine.predict, []

    def once(*arguments: object) -> object:
        calls.append(1)
        position = predict(*arguments)
        return position if len(calls) == 1 else np.full_like(position, np.nan)

    monkeypatch.setattr(bench.engine, "predict", once)
    found = refit(bench.shooting, fit, without_one)
    assert len(calls) > 2
    np.testing.assert_array_equal(found.values, np.tile(fit.values[0], (2, 1)))
    np.testing.assert_allclose(found.per_segment[0], fit.per_segment, atol=0.2)


def test_a_segment_whose_simulation_fails_at_first_is_not_perfect(bench, without_one, monkeypatch) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    wanted, predict, calls = refit(bench.shooting, fit, without_one), bench.engine.predict, []

    def fails_at_first(*arguments: object) -> object:
        calls.append(1)
        position = np.array(predict(*arguments))
        if len(calls) == 1:
            position[:, 0] = np.nan
        return position

    monkeypatch.setattr(bench.engine, "predict", fails_at_first)
    found = refit(bench.shooting, fit, without_one)
    np.testing.assert_allclose(found.per_segment[:, 0], wanted.per_segment[:, 0], rtol=0.2)


def test_after_a_step_that_fails_the_next_ones_are_whole_again(bench, without_one, monkeypatch) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    far = dataclasses.replace(fit, values=(2.0 * fit.values[0],), design=None)
    far = bench.shooting.fit([(fit.effects, far.values)], fit.starts, hold=True, rounds=1)[0]
    wanted, predict, calls = refit(bench.shooting, fit, without_one), bench.engine.predict, []

    def fails_once(*arguments: object) -> object:
        calls.append(1)
        position = predict(*arguments)
        return np.full_like(position, np.nan) if len(calls) == 2 else position

    monkeypatch.setattr(bench.engine, "predict", fails_once)
    found = refit(bench.shooting, far, without_one)
    error = 1.0 / np.sqrt(fit.information[0, 0])
    np.testing.assert_allclose(found.values, wanted.values, atol=0.1 * error)


def test_a_nominal_that_fails_somewhere_has_an_infinite_chi2_there(bench) -> None:
    per_segment = bench.nominal.per_segment.copy()
    per_segment[1] = FAILED
    failed = dataclasses.replace(bench.nominal, per_segment=per_segment)
    found = refit(bench.shooting, failed, np.ones((2, bench.segments.size), dtype=bool)).per_segment
    assert np.isinf(found[:, 1]).all()
    np.testing.assert_array_equal(np.delete(found, 1, axis=1), np.tile(np.delete(per_segment, 1), (2, 1)))
