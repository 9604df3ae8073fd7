from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.forecast import free_run
from torch_activegp.diagnosis.findings.unsure_runs import expected_error
from torch_activegp.diagnosis.selection.intervals import covariance
from torch_activegp.diagnosis.simulation.candidate import Candidate


def test_the_expected_error_is_that_of_draws_from_the_covariance(bench) -> None:
    keys = ("viscous_friction", "joint:hip"), ("actuator_gain", "actuator:drive"), ("armature_error", "joint:hip")
    effects = tuple(bench.effect(*key) for key in keys)
    guess = tuple(np.array([value]) for value in (bench.viscous, 0.0, 0.01))
    fit = bench.shooting.fit([(effects, guess)], bench.nominal.starts)[0]
    runs, spread = bench.machine.holdout, covariance(bench.shooting, fit, widened=True)
    assert spread[1, 2] > 0.5 * np.sqrt(spread[1, 1] * spread[2, 2])  # else the axes would not matter
    drawn = np.random.default_rng(0).multivariate_normal(np.concatenate(fit.values), spread, size=200)
    candidates = [fit.candidate, *(Candidate(effects, tuple(np.split(row, 3))) for row in drawn)]
    center, *others = (paths[0][0] for paths in free_run(bench.engine, candidates, runs, bench.shooting.noise))
    squares = [((other - center) ** 2).mean() for other in others]
    wanted = np.sqrt(np.mean(squares)) / runs[0].position.std()
    assert expected_error(bench.engine, bench.shooting, fit, runs) == pytest.approx(wanted, rel=0.15)
