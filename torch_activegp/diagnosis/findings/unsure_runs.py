"""How far free runs go by what the parameters of a set are uncertain alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.findings.forecast import free_run, rms, units_of_errors
from torch_activegp.diagnosis.inputs.runs import Array, Run
from torch_activegp.diagnosis.selection.intervals import covariance
from torch_activegp.diagnosis.shooting.fit import Fit, split
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine


def expected_error(engine: Engine, shooting: Shooting, fit: Fit, runs: Sequence[Run]) -> float:
    """Error of free runs that the uncertainty of a set's parameters makes, as part of the motion (NRMSE).

    To first order: of a step along each principal axis of their covariance, one standard error long, with the initial
    states fitted anew. A pallet on a belt that nothing holds drifts by any friction that is left: with the right one,
    known to 11 %, its free runs were 0.0042 of the motion away, 17 times the noise, and 0.0022 by this.

    Args:
        engine: simulates the runs.
        shooting: the likelihood of the recordings that were fitted.
        fit: the set.
        runs: others.
    """
    variance, axes = np.linalg.eigh(covariance(shooting, fit, widened=True))
    moved = np.concatenate(fit.values) + np.sqrt(np.maximum(variance, 0.0))[:, None] * axes.T
    candidates = [fit.candidate, *(Candidate(fit.effects, split(fit.effects, some)) for some in moved)]
    center, *others = free_run(engine, candidates, runs, shooting.noise)
    units = [units_of_errors(run, shooting.noise)[0] for run in runs]

    def squared(other: Sequence[tuple[Array, Array]]) -> float:
        pairs = zip(center, other, units, strict=True)
        return rms(np.concatenate([((there - here) / unit).ravel() for (here, _), (there, _), unit in pairs])) ** 2

    return float(np.sqrt(sum(map(squared, others))))
