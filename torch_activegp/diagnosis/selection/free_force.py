"""How positions respond to a force that is free in time: what any dynamics at all could explain."""

from __future__ import annotations

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.linearize import linearize

_BIN = 0.1


def free_force_columns(shooting: Shooting, fit: Fit, seconds: float = _BIN) -> tuple[Array, Array, Array]:
    """Derivatives of the positions by the initial states and by a force on each recorded joint in each bin of time.

    Returns:
        Residuals ``(S, K + 1, C)``, derivatives by states ``(S, K + 1, C, n)`` and by forces ``(S, K + 1, C, B)``, all
        in rad or m, not whitened.
    """
    segments, engine = shooting.segments, shooting.engine
    linear = linearize(shooting, fit)
    bins = max(round(float(segments.dt.sum(1).mean()) / seconds), 1)
    edges = np.linspace(0, segments.intervals, bins + 1).round()
    within = np.digitize(np.arange(segments.intervals), edges[1:-1])
    boxes = np.broadcast_to(within[:, None] == np.arange(bins), (segments.size, segments.intervals, bins))
    strengths = [0.02 / max(float(engine.model.dof_invweight0[dof]), 1e-12) for dof in engine.channels.dof]
    forces = [linear.respond_to_force(c, strength * boxes) for c, strength in enumerate(strengths)]
    exact = engine.predict(segments, fit.starts[None], [fit.candidate])
    return shooting.measured - np.nan_to_num(exact[0]), linear.respond_to_start(), np.concatenate(forces, axis=-1)
