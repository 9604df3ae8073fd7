"""How a lab tunes a machine that sticks and slips: forces from filtered accelerations, where it slides."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from benchmarks.unseen.machine import Machine

Array = np.ndarray


def _error(machine: Machine, q: Array, v: Array, a: Array, u: Array, values: dict[str, float]) -> Array:
    """Force that the model lacks at each sample (N, n)."""
    plant = machine.plant({k: np.asarray(x) for k, x in values.items()})
    M, rhs, _, _ = plant.smooth(np.zeros(len(q)), q, v, np.zeros((len(q), 0)), u)
    return (M @ a[..., None])[..., 0] - rhs + plant.friction.level(np.sign(v), q, v) * np.sign(v)


def regress(machine: Machine, readings: Array, control: Array, tune: tuple[str, ...]) -> dict[str, float]:
    """Least squares over all runs (B, K, .), with a weak prior at the values of the file."""
    width = 2 * round(0.03 / machine.dt) + 1
    q, v, a = (savgol_filter(readings, width, 3, deriv=d, delta=machine.dt, axis=1)[:, width:-width] for d in range(3))
    # the command is held from its sample on: half of it belongs to the sample before
    u = 0.5 * (control[:, width:-width] + control[:, width - 1 : -width - 1])
    q, v, a, u = (x.reshape(-1, x.shape[-1]) for x in (q, v, a, u))
    slides = np.abs(v) > 0.1 * v.std(0)
    values = machine.values()
    nominal = _error(machine, q, v, a, u, values)
    weight = slides / nominal.std(0)
    columns, spans = [], []
    for k in tune:
        span = abs(values[k]) or 0.05
        columns.append((_error(machine, q, v, a, u, {**values, k: values[k] + span}) - nominal) * weight)
        spans.append(span)
    J = np.stack([c.ravel() for c in columns], 1)
    r = (nominal * weight).ravel()
    step = -np.linalg.solve(J.T @ J + 4.0 * np.eye(len(tune)), J.T @ r)
    return {**values, **{k: values[k] + max(d, -0.8) * s for k, d, s in zip(tune, step, spans, strict=True)}}
