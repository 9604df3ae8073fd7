"""How wrong a plant is about motions: windows of 1 s with free initial states, over the noise; and what touches."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from benchmarks.concealed.plant import J, Plant, copy
from benchmarks.concealed.truth import Motion, open_loop, simulate

COARSE = 1e-3
"""Step of the evaluation, s: good to 1e-5 rad; a quarter of it where there is a wall."""

Edit = Callable[[Plant, float], None]


@dataclasses.dataclass(frozen=True)
class Window:
    """Rows of a run: time from zero (K,), controls (K, m), readings (K, n) and the true state at the first row."""

    time: np.ndarray
    controls: np.ndarray
    reading: np.ndarray
    q: np.ndarray
    v: np.ndarray


def windows(times: Sequence[np.ndarray], motions: Sequence[Motion], count: int, seconds: float = 1.0) -> list[Window]:
    """Cut runs into windows and keep `count` of them, spread evenly."""
    found = []
    for time, motion in zip(times, motions, strict=True):
        for start in np.arange(0, time[-1] - seconds + 1e-9, seconds):
            rows = np.flatnonzero((time >= start) & (time <= start + seconds))
            first = rows[0]
            found.append(
                Window(time[rows] - time[first], motion.u[rows], motion.y[rows], motion.q[first], motion.v[first])
            )
    chosen = np.unique(np.linspace(0, len(found) - 1, count).round().astype(int))
    return [found[index] for index in chosen]


def _reading(plant: Plant, window: Window, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    step = COARSE / 4 if np.isfinite(plant.joint[:, J.WALL]).any() else COARSE
    return simulate(plant, open_loop(window.time, window.controls, len(q)), q, v, step).y


def projected(
    plant: Plant, window: Window, deviation: np.ndarray, edits: Sequence[tuple[Edit, float]] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Residual (K n,) and its change by each edit (K n, P), over the noise, with the initial state projected out."""
    n = len(window.q)
    expected = _reading(plant, window, window.q, window.v)
    columns = []
    for k in range(2 * n):
        nudge = np.eye(2 * n)[k] * (1e-4 if k < n else 1e-3)
        moved = _reading(plant, window, window.q + nudge[:n], window.v + nudge[n:])
        columns.append(((moved - expected) / deviation).ravel() / nudge[k])
    basis, _ = np.linalg.qr(np.array(columns).T)
    residual = ((window.reading - expected) / deviation).ravel()
    changes = np.zeros((len(residual), len(edits)))
    for k, (edit, size) in enumerate(edits):
        changed = copy(plant)
        edit(changed, size)
        changes[:, k] = ((_reading(changed, window, window.q, window.v) - expected) / deviation).ravel() / size
    return residual - basis @ (basis.T @ residual), changes - basis @ (basis.T @ changes)


def misfit(plant: Plant, found: Sequence[Window], deviation: np.ndarray) -> float:
    """Expected chi2 per degree of freedom of a plant on noisy readings of these windows; inf where one diverges."""
    total, freedom = 0.0, 0
    for window in found:
        residual, _ = projected(plant, window, deviation)
        total += float(residual @ residual)
        freedom += residual.size - 2 * len(window.q)
    return 1 + total / freedom if np.isfinite(total) else np.inf


def touches(model: mujoco.MjModel, motions: Sequence[Motion]) -> bool:
    """Whether anything touches anything in any pose of some motions."""
    data = mujoco.MjData(model)
    for q in np.vstack([motion.q[::3] for motion in motions]):
        data.qpos[:] = q
        mujoco.mj_fwdPosition(model, data)
        if data.ncon:
            return True
    return False
