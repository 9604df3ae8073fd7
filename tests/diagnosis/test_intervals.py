from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy import stats

from torch_activegp.diagnosis.intervals import covariance, estimates


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


def test_what_is_alike_within_a_recording_widens_the_interval_as_leaving_recordings_out_does(bench) -> None:
    rng, recordings, each = np.random.default_rng(1), 5, 8
    design, pushes = np.ones((recordings * each, 1)), np.repeat(rng.normal(size=recordings), each)
    pushes -= pushes.mean()
    run = np.repeat(np.arange(recordings), each)
    segments = dataclasses.replace(bench.segments.pick(np.zeros(run.size, dtype=np.int64)), run=run)
    fit = dataclasses.replace(
        bench.nominal,
        effects=(),
        values=(np.zeros(1),),
        chi2=float(bench.shooting.dof),
        information=design.T @ design,
        scores=design * pushes[:, None],
        design=np.zeros((run.size, 1, 2)),
        columns=design[:, None],
    )
    left_out = np.array([pushes[run != number].mean() for number in range(recordings)])
    jackknife = (recordings - 1) / recordings * (left_out**2).sum()
    shooting = dataclasses.replace(bench.shooting, segments=segments)
    assert covariance(shooting, fit)[0, 0] == pytest.approx(jackknife)
    assert jackknife > 3 * (pushes**2).sum() / pushes.size**2
    fewer = dataclasses.replace(shooting, segments=dataclasses.replace(segments, run=np.minimum(run, 2)))
    assert covariance(fewer, fit)[0, 0] < 0.5 * jackknife
    assert covariance(shooting, fit.without_derivatives)[0, 0] < 0.5 * jackknife


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
