from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

from torch_activegp.diagnosis.selection.intervals import covariance, estimates, is_certain


def test_the_interval_holds_the_truth_and_is_as_wide_as_the_information_says(bench) -> None:
    fit = bench.fit("viscous_friction", 0.01)
    (estimate,) = estimates(bench.shooting, fit, fit.effects[0]).values()
    low, high = estimate.ci95
    assert low < bench.viscous < high
    assert estimate.unit == "N m s/rad"
    least = 2 * stats.t.ppf(0.975, bench.segments.size - 1) * np.sqrt(1.0 / fit.information[0, 0])
    assert 0.9 * least < high - low < 3 * least
    assert high - low < 0.1 * bench.viscous


def test_the_covariance_is_that_of_least_squares_for_independent_segments(bench) -> None:
    rng, truth = np.random.default_rng(0), np.array([1.0, -2.0])
    design = rng.normal(size=(200, 30, 2))
    residual = rng.normal(size=(200, 30))
    normal = design.transpose(0, 2, 1) @ design
    scores = np.einsum("smp,sm->sp", design, residual)
    fit = dataclasses.replace(
        bench.nominal,
        effects=(),
        values=(truth,),
        chi2=float(bench.shooting.dof - 2),
        information=normal.sum(0),
        scores=scores,
    )
    found = covariance(bench.shooting, fit)
    wanted = np.linalg.inv(normal.sum(0))
    assert np.diag(found) == pytest.approx(np.diag(wanted), rel=0.35)
    assert (np.diag(found) >= 0.999 * np.diag(wanted)).all()


def test_scores_that_vary_more_than_the_noise_widen_the_interval(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    wild = dataclasses.replace(fit, scores=20 * fit.scores)
    assert covariance(bench.shooting, wild)[0, 0] > 10 * covariance(bench.shooting, fit)[0, 0]


def test_what_the_scores_do_not_tell_from_nothing_is_not_certain(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    (friction,) = fit.effects
    assert is_certain(bench.shooting, fit, [friction])
    much = dataclasses.replace(fit, scores=100.0 * fit.scores)
    error = np.sqrt(covariance(bench.shooting, much)[0, 0])
    wide = stats.t.ppf(0.975, bench.segments.size - 1)
    for times, certain in ((0.95 * wide, False), (1.05 * wide, True), (3.8, True), (4.0, True)):
        wild = dataclasses.replace(much, scores=much.scores * fit.values[0][0] / (times * error))
        assert is_certain(bench.shooting, wild, [friction]) is certain
        assert is_certain(bench.shooting, wild, [friction], alone=True) is bool(times > 3.9)
        (estimate,) = estimates(bench.shooting, wild, friction).values()
        assert (estimate.ci95[0] > 0.0) is certain
    assert not is_certain(bench.shooting, dataclasses.replace(fit, values=(np.zeros(1),)), [friction])
    assert is_certain(bench.shooting, dataclasses.replace(wild, information=np.zeros((1, 1))), [friction])
    for name, values in (("joint_stop", (1.0, 0.0, 0.5)), ("actuator_delay", (1e-9,))):
        law = next(effect for effect in bench.effects if effect.name == name)
        size = len(law.parameters)
        wild = dataclasses.replace(fit, effects=(law,), values=(np.array(values),), information=np.eye(size))
        wild = dataclasses.replace(wild, scores=np.full((len(fit.scores), size), 1e3))
        assert is_certain(bench.shooting, wild, [law])  # how much says little of whether


def test_what_nothing_depends_on_has_a_finite_interval_that_says_nothing(bench) -> None:
    """Such as the place of a stop without stiffness."""
    fit = bench.fit("viscous_friction", 0.05)
    stop = bench.effect("joint_stop")
    unseen = np.zeros((3, 3))
    unseen[1, 1] = 1e4
    there = dataclasses.replace(
        fit,
        effects=(stop,),
        values=(np.array([0.0, 0.3, 0.5]),),
        information=unseen,
        scores=np.zeros((len(fit.scores), 3)),
    )
    for name, estimate in estimates(bench.shooting, there, stop).items():
        low, high = estimate.ci95
        assert np.isfinite([low, high]).all()
        assert low <= estimate.value <= high
        assert high - low > (0.01 if name == "damping" else 10.0)
    assert estimates(bench.shooting, there, stop)["damping"].ci95[1] < 1.0
    blind = dataclasses.replace(there, information=np.zeros((3, 3)))
    position = estimates(bench.shooting, blind, stop)["position"]
    scale = next(parameter.scale for parameter in stop.parameters if parameter.name == "position")
    assert position.ci95[1] - position.value == pytest.approx(150.0 * max(abs(position.value), scale))  # its own scale


def _recorded(bench, rng, recordings, each, excitement, alike):
    """A shooting of some recordings, and a fit of two parameters with what is alike within each among its scores."""
    run = np.repeat(np.arange(recordings), each)
    segments = dataclasses.replace(bench.segments.pick(np.zeros(run.size, dtype=np.int64)), run=run)
    design = excitement[run, None, None] * rng.normal(size=(run.size, 30, 2))
    residual = rng.normal(size=(run.size, 30)) + alike * rng.normal(size=recordings)[run, None]
    normal = np.einsum("smp,smq->pq", design, design)
    design[..., 0] += 3.0 * (alike > 0.0)  # what is alike pushes the first
    shooting = dataclasses.replace(bench.shooting, segments=segments)
    fit = dataclasses.replace(
        bench.nominal,
        effects=(),
        values=(np.zeros(2),),
        chi2=float(shooting.dof - 2),
        information=normal,
        scores=np.einsum("smp,sm->sp", design, residual),
    )
    return shooting, fit


def test_what_is_alike_within_a_recording_widens_the_interval(bench) -> None:
    """By as much as the sums of their scores differ, which is more than those of segments do."""
    shooting, fit = _recorded(bench, np.random.default_rng(1), 5, 8, np.array([1.0, 2.0, 1.0, 0.5, 3.0]), alike=1.0)
    sums = fit.scores.reshape(5, 8, 2).sum(axis=1)
    inverse = np.linalg.inv(fit.information)
    wanted = 5 / 4 * inverse @ sums.T @ sums @ inverse
    found, without = covariance(shooting, fit), covariance(shooting, fit, recordings=False)
    assert found[0, 0] == pytest.approx(wanted[0, 0])
    assert found[0, 0] > 3 * without[0, 0]
    fewer = dataclasses.replace(shooting.segments, run=np.minimum(shooting.segments.run, 2))
    assert covariance(dataclasses.replace(shooting, segments=fewer), fit) == pytest.approx(without)


@pytest.mark.parametrize(("last", "counts"), [(4, True), (3, True), (2, True), (1, False)])
def test_the_spread_of_few_recordings_is_widened_by_what_they_do_not_say_of_it(bench, last, counts) -> None:
    """With one degree of freedom less than there are recordings, and three at least."""
    shooting, fit = _recorded(bench, np.random.default_rng(1), 5, 8, np.array([1.0, 2.0, 1.0, 0.5, 3.0]), alike=1.0)
    run = np.minimum(shooting.segments.run, last)
    shooting = dataclasses.replace(shooting, segments=dataclasses.replace(shooting.segments, run=run))
    sums, inverse = np.zeros((last + 1, 2)), np.linalg.inv(fit.information)
    np.add.at(sums, run, fit.scores)
    spread = ((sums @ inverse)[:, 0] ** 2).sum() * (last + 1) / last
    farther = stats.t.ppf(0.975, last) / stats.t.ppf(0.975, 40 - 2)
    found, without = covariance(shooting, fit, widened=True), covariance(shooting, fit, recordings=False)
    assert found[0, 0] == pytest.approx(farther**2 * spread if counts else without[0, 0])


def test_one_recording_that_says_most_widens_no_interval(bench) -> None:
    excitement, ratios = np.array([1.0, 1.0, 30.0, 1.0, 1.0]), []
    for seed in range(20):
        shooting, fit = _recorded(bench, np.random.default_rng(seed), 5, 8, excitement, alike=0.0)
        ratios.append(np.diag(covariance(shooting, fit)) / np.diag(np.linalg.inv(fit.information)))
    assert np.sqrt(np.median(ratios)) < 1.5


def test_a_derived_parameter_gets_its_own_unit(bench) -> None:
    effect = bench.effect("actuator_gain", "actuator:drive")
    fit = bench.shooting.fit([((effect,), (np.array([0.05]),))], bench.nominal.starts)[0]
    (name, estimate), *_ = estimates(bench.shooting, fit, effect).items()
    assert (name, estimate.unit) == ("gain", "1")
    assert estimate.value == pytest.approx(1.0 + fit.values[0][0])


def test_what_is_never_negative_has_no_negative_interval(bench) -> None:
    effect = bench.effect("joint_stop")
    fit = bench.shooting.fit([((effect,), (effect.seeds[-1],))], bench.nominal.starts)[0]
    information = np.diag([0.3, 1e-9, 1e6]) / np.maximum(fit.values[0], 1e-3) ** 2
    loose = dataclasses.replace(
        fit, values=(np.array([50.0, 2.0, 0.3]),), information=information, scores=fit.scores[:3]
    )
    found = estimates(bench.shooting, loose, effect)
    for name in ("stiffness", "damping"):
        low, high = found[name].ci95
        assert 0.0 < low < found[name].value < high < np.inf
        assert low * high == pytest.approx(found[name].value ** 2)
    assert sum(found["position"].ci95) == pytest.approx(2 * found["position"].value)
