from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings import unsure_runs
from torch_activegp.diagnosis.findings.forecast import errors_of_free_runs, free_run
from torch_activegp.diagnosis.findings.unsure_runs import expected_error
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.selection.intervals import covariance
from torch_activegp.diagnosis.shooting.fit import Fit, split
from torch_activegp.diagnosis.simulation.candidate import Candidate

KEYS = ("viscous_friction", "joint:hip"), ("actuator_gain", "actuator:drive"), ("armature_error", "joint:hip")


@pytest.fixture(scope="module")
def known(bench) -> Fit:
    """A friction, a gain and a rotor, of which the last two are alike, off the bound of a rotor."""
    effects = tuple(bench.effect(*key) for key in KEYS)
    guess = tuple(np.array([value]) for value in (bench.viscous, 0.0, 0.01))
    fit = bench.shooting.fit([(effects, guess)], bench.nominal.starts)[0]
    return dataclasses.replace(fit, values=(*fit.values[:2], np.array([0.01])))


@pytest.fixture(scope="module")
def runs(bench, record) -> tuple:
    """Two of different length."""
    kept = [record("viscous", 9, "kept"), record("viscous", 10, "long", seconds=4.0)]
    return make_machine(bench.machine.model, [record("viscous", 0)], kept).holdout


def starts_of(bench, fit: Fit, runs: tuple) -> np.ndarray:
    return np.stack([start for _, start in free_run(bench.engine, [fit.candidate], runs, bench.shooting.noise)[0]])


def test_the_expected_error_is_that_of_draws_from_the_covariance(bench, known, runs) -> None:
    spread = covariance(bench.shooting, known, widened=True)
    assert spread[1, 2] > 0.5 * np.sqrt(spread[1, 1] * spread[2, 2])  # else the axes would not matter
    drawn = np.random.default_rng(0).multivariate_normal(np.concatenate(known.values), spread, size=200)
    candidates = [known.candidate, *(Candidate(known.effects, split(known.effects, row)) for row in drawn)]
    center, *others = free_run(bench.engine, candidates, runs, bench.shooting.noise)
    off = [[a - b for (a, _), (b, _) in zip(other, center, strict=True)] for other in others]
    errors = errors_of_free_runs(runs, off, bench.shooting.noise)
    found = expected_error(bench.engine, bench.shooting, known, runs, starts_of(bench, known, runs))
    assert found == pytest.approx(np.sqrt((errors**2).mean()), rel=0.15)


def test_what_is_less_certain_is_expected_to_go_farther(bench, known, runs) -> None:
    starts = starts_of(bench, known, runs)
    first = expected_error(bench.engine, bench.shooting, known, runs, starts)
    less = dataclasses.replace(known, information=known.information / 1e4, scores=known.scores / 1e2)
    assert expected_error(bench.engine, bench.shooting, less, runs, starts) == pytest.approx(1e2 * first, rel=0.1)


def test_what_is_not_known_is_no_excuse_nor_is_a_simulation_that_fails(bench, known, runs, monkeypatch) -> None:
    starts = starts_of(bench, known, runs)
    held = dataclasses.replace(known, information=np.zeros((0, 0)), scores=np.zeros((len(known.scores), 0)))
    for fit in (held, bench.nominal):
        assert expected_error(bench.engine, bench.shooting, fit, runs, starts) == 0.0
    values = np.concatenate(known.values)
    monkeypatch.setattr(unsure_runs, "_moved", lambda *_: np.stack([values, np.full(3, np.nan)]))
    assert expected_error(bench.engine, bench.shooting, known, runs, starts) == 0.0


def test_parameters_are_moved_within_their_bounds_in_any_units(bench, known) -> None:
    low = bench.effect("viscous_friction").parameters[0].low
    edge = dataclasses.replace(known, values=(np.array([low]), *known.values[1:]))
    moved = unsure_runs._moved(bench.shooting, edge)
    assert (moved[:, 0] >= low).all()
    assert (moved[:, 0] > low).any()
    spread = covariance(bench.shooting, known, widened=True)
    steps = (unsure_runs._moved(bench.shooting, known) - np.concatenate(known.values)) / 0.1
    np.testing.assert_allclose(steps.T @ steps, spread, rtol=1e-6, atol=1e-6 * np.abs(spread).min())


def test_few_recordings_widen_what_is_expected(bench, known, monkeypatch) -> None:
    def wider(shooting, fit, recordings: bool = True, widened: bool = False) -> np.ndarray:
        return (9.0 if widened else 1.0) * covariance(shooting, fit)

    plain = covariance(bench.shooting, known)
    monkeypatch.setattr(unsure_runs, "covariance", wider)
    steps = (unsure_runs._moved(bench.shooting, known) - np.concatenate(known.values)) / 0.1
    np.testing.assert_allclose(np.diag(steps.T @ steps), 9.0 * np.diag(plain), rtol=1e-6)
