"""How far free runs go by what the parameters of a set are uncertain alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.findings.beginnings import Beginnings
from torch_activegp.diagnosis.findings.forecast import errors_of_free_runs, whole_runs
from torch_activegp.diagnosis.inputs.runs import Array, Run, median_step
from torch_activegp.diagnosis.selection.intervals import covariance
from torch_activegp.diagnosis.shooting.fit import Fit, bounds, split
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

_PART = 0.1
"""Part of a standard error by which parameters are moved, so that what follows is of first order."""


def expected_error(engine: Engine, shooting: Shooting, fit: Fit, runs: Sequence[Run], starts: Array) -> float:
    """Error of free runs that the uncertainty of a set's parameters makes, as part of the motion (NRMSE).

    To first order (the delta method), with the initial states fitted anew beside each change. A pallet on a belt that
    nothing holds drifts by any friction that is left: with the right one, known to 11 %, its free runs were 0.0042 of
    the motion away, 17 times the noise, and by this 0.0024.

    Args:
        engine: simulates the runs.
        shooting: the likelihood of the recordings that were fitted.
        fit: the set.
        runs: R others.
        starts: initial states with which the set follows them, ``(R, nq + nv)``.

    Returns:
        Zero where nothing is known of the parameters, and where a simulation fails: neither is an excuse.
    """
    if not fit.size or not fit.is_known:
        return 0.0
    candidates = [fit.candidate, *(Candidate(fit.effects, split(fit.effects, some)) for some in _moved(shooting, fit))]
    whole = whole_runs(runs)
    begin = Beginnings(engine, shooting.noise, candidates, median_step(runs))
    center, *others = engine.predict(whole, begin.fit(whole, starts), candidates)
    apart = [[(path[i] - center[i])[: len(run)] / _PART for i, run in enumerate(runs)] for path in others]
    if not all(np.isfinite(off).all() for some in apart for off in some):
        return 0.0
    errors = errors_of_free_runs(runs, apart, shooting.noise)
    return float(np.sqrt((errors**2).sum(axis=0).mean()))


def _moved(shooting: Shooting, fit: Fit) -> Array:
    """Parameters a part of a standard error away along each principal axis of their correlation, ``(P, P)``."""
    spread = covariance(shooting, fit, widened=True)
    errors = np.sqrt(np.maximum(np.diag(spread), 0.0))
    units = np.where(errors > 0.0, errors, 1.0)
    share, axes = np.linalg.eigh(spread / np.outer(units, units))
    step = _PART * np.sqrt(np.maximum(share, 0.0))[:, None] * axes.T * units
    values, (low, high) = np.concatenate(fit.values), bounds(fit.effects)
    leaves = ((values + step < low) | (values + step > high)).any(axis=1, keepdims=True)
    return np.clip(np.where(leaves, values - step, values + step), low, high)
