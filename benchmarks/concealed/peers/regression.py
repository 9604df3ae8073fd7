"""Smoothed accelerations, the same list of laws, and forward selection by BIC: the usual way with our vocabulary."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from benchmarks.concealed.peers.recorded import Recorded, answer, load, missing_force, names_of

MOST = 4
"""Effects that are named at most."""

Candidate = tuple[str, str, list[np.ndarray]]
"""Name, target, and the columns (N n,) of its linear parameters; shapes are scanned, one candidate for each."""


def _joint_laws(r: Recorded, j: int) -> Iterator[tuple[str, list[np.ndarray]]]:
    q, v, a = r.q[:, j], r.v[:, j], r.expected[:, j]
    top, low, high = np.quantile(np.abs(v), 0.95), *np.quantile(q, [0.02, 0.98])
    sign = np.sign(v)
    yield "viscous_friction", [-v]
    yield "coulomb_friction", [-sign]
    yield "asymmetric_friction", [np.where(v > 0, -1.0, 0.0), np.where(v < 0, 1.0, 0.0)]
    yield "asymmetric_friction", [-np.maximum(v, 0), -np.minimum(v, 0)]
    for share in (0.03, 0.06, 0.12):
        yield "stribeck_friction", [-sign, -sign * np.exp(-((v / (share * top)) ** 2))]
    yield "quadratic_drag", [-v * np.abs(v)]
    yield "linear_spring", [-q, np.ones_like(q)]
    yield "cubic_spring", [-(q**3)]
    yield "constant_force", [np.ones_like(q)]
    yield "armature_error", [-a]
    for periods in np.geomspace(2.0, 20.0, 24) * np.pi / max(high - low, 1e-9):
        yield "cogging", [np.sin(periods * q), np.cos(periods * q)]
    for share in (0.8, 0.9, 0.95, 0.98):
        for side in (1, -1):
            edge = np.quantile(side * q, share)
            past = (side * q > edge) * 1.0
            yield "joint_stop", [-side * past * (side * q - edge), -past * v]


def _motor_laws(r: Recorded, i: int, drive: np.ndarray) -> Iterator[tuple[str, list[np.ndarray]]]:
    """Laws on a control, as the force that they add per unit: `drive` is the torque of one unit (N, n)."""
    u, top = r.u[:, i : i + 1], np.quantile(np.abs(r.u[:, i]), 0.99)
    yield "actuator_gain", [(drive * u).ravel()]
    yield "actuator_delay", [(-drive * r.rate[:, i : i + 1]).ravel()]
    for share in (0.5, 0.65, 0.8, 0.9):
        over = np.sign(u) * np.maximum(np.abs(u) - share * top, 0)
        yield "actuator_saturation", [(-drive * over).ravel()]
    for share in (0.03, 0.08, 0.2):
        yield "actuator_dead_zone", [(-drive * np.clip(u, -share * top, share * top) / share).ravel()]


def _body_laws(model: mujoco.MjModel, r: Recorded) -> Iterator[Candidate]:
    before = missing_force(model, r.q, r.v, r.expected, r.u)
    for body in range(1, model.nbody):
        name, mass, place = model.body(body).name, model.body_mass[body], model.body_ipos[body].copy()
        model.body_mass[body] *= 1.05
        heavier = missing_force(model, r.q, r.v, r.expected, r.u)
        model.body_mass[body] = mass
        yield "payload_mass", f"body:{name}", [-(heavier - before).ravel()]
        moved = []
        for axis in range(3):
            model.body_ipos[body, axis] += 0.01
            moved.append(-(missing_force(model, r.q, r.v, r.expected, r.u) - before).ravel())
            model.body_ipos[body] = place
        yield "center_of_mass_offset", f"body:{name}", moved
    turned, gravity = [], model.opt.gravity.copy()
    for axis in range(3):
        model.opt.gravity[axis] += 0.1
        turned.append(-(missing_force(model, r.q, r.v, r.expected, r.u) - before).ravel())
        model.opt.gravity[:] = gravity
    yield "gravity_error", "world", turned


def candidates(model: mujoco.MjModel, r: Recorded) -> Iterator[Candidate]:
    """All laws on all targets."""
    joints, actuators = names_of(model)
    n = len(joints)
    for j, joint in enumerate(joints):
        for name, columns in _joint_laws(r, j):
            yield name, f"joint:{joint}", [np.kron(column, np.eye(n)[j]) for column in columns]
    for i, actuator in enumerate(actuators):
        drive = np.zeros((len(r.q), n))
        drive[:, model.actuator_trnid[i, 0]] = model.actuator_gear[i, 0] * model.actuator_gainprm[i, 0]
        for name, columns in _motor_laws(r, i, drive):
            yield name, f"actuator:{actuator}", columns
    yield from _body_laws(model, r)


def diagnose(folder: Path) -> dict[str, Any]:
    """Forward selection on the whitened residual force; for BIC, one row in each smoother's length is independent."""
    model, r = load(folder, most=3000)
    scale = 1.4826 * np.median(np.abs(r.residual - np.median(r.residual, 0)), 0) + 1e-12
    target = (r.residual / scale).ravel()
    weights = np.tile(1 / scale, len(r.q))
    pool = []
    for name, place, columns in candidates(model, r):
        matrix = np.column_stack(columns) * weights[:, None]
        norm = np.linalg.norm(matrix, axis=0)
        if (norm > 1e-9).all():
            pool.append((name, place, matrix / norm))
    independent = r.independent * r.q.shape[1]
    chosen: list[int] = []
    best = independent * np.log(target @ target / len(target))
    for _ in range(MOST):
        scores = {k: _bic(target, [pool[c][2] for c in (*chosen, k)], independent) for k in range(len(pool))}
        k = min(scores, key=scores.__getitem__)
        if scores[k] > best - 6:
            break
        best = scores[k]
        chosen.append(k)
    named = list(dict.fromkeys((pool[k][0], pool[k][1]) for k in chosen))
    places = [place for place in dict.fromkeys(place for _, place in named) if place.startswith("joint:")]
    return answer(named, bool(named), places)


def _bic(target: np.ndarray, matrices: list[np.ndarray], independent: float) -> float:
    matrix = np.column_stack(list(itertools.chain(matrices)))
    normal = matrix.T @ matrix + 1e-9 * np.eye(matrix.shape[1])
    slope = matrix.T @ target
    left = max(float(target @ target - slope @ np.linalg.solve(normal, slope)), 1e-12)
    return independent * np.log(left / len(target)) + matrix.shape[1] * np.log(independent)
