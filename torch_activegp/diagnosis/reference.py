"""How positions respond to a force that is free in time: what any dynamics at all could explain."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from torch_activegp.diagnosis.engine import Candidate
from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.shooting import Shooting

_BIN = 0.1


def free_force_columns(shooting: Shooting, fit: Fit, seconds: float = _BIN) -> tuple[Array, Array, Array]:
    """Derivatives of the positions by the initial states and by a force on each recorded joint in each bin of time.

    Returns:
        Residuals ``(S, K + 1, C)``, derivatives by states ``(S, K + 1, C, n)`` and by forces ``(S, K + 1, C, B)``, all
        in rad or m, not whitened.
    """
    segments, engine = shooting.segments, shooting.differences
    sizes = shooting.state_columns(fit.starts)
    n, base = len(sizes), fit.candidate
    bins = max(round(float(segments.dt.sum(1).mean()) / seconds), 1)
    edges = np.linspace(0, segments.intervals, bins + 1).round().astype(int)
    pushes = []
    for dof in engine.channels.dof:
        strength = 0.02 / max(float(engine.model.dof_invweight0[dof]), 1e-12)
        for a, b in itertools.pairwise(edges):
            force = np.zeros((segments.size, segments.intervals, engine.model.nv))
            force[:, a:b, dof] = strength
            pushes.append(dataclasses.replace(base, force=force))
    candidates: list[Candidate] = [base] * (1 + n) + pushes
    starts = np.repeat(fit.starts[None], len(candidates), axis=0)
    starts[1 : 1 + n] += np.eye(n)[:, None, :] * sizes
    predicted = np.nan_to_num(engine.predict(segments, starts, candidates)[0])
    moved = np.moveaxis(predicted[1:] - predicted[0], 0, -1)
    measured = segments.position if shooting.offset is None else segments.position - shooting.offset
    exact, _ = shooting.engine.predict(segments, fit.starts[None], [base])
    return measured - np.nan_to_num(exact[0]), moved[..., :n] / sizes, moved[..., n:]
