"""MultiArm: trajectory least squares on the first 36.7 s, free run over the 18.3 s that follow."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import scipy.io
from scipy.optimize import least_squares

from benchmarks.real.regression import rms
from torch_activegp.data import fetch, load_multiarm, multiarm_model

TERMS = "gcfd"
"""Gravity [1/s2], viscous [1/s], Coulomb [rad/s2], quadratic [1/rad], each over the inertia."""
PIECE = 9.166
Array = np.ndarray
_START = {"g": 64.0, "c": 0.06, "f": 0.1, "d": 0.003}


def simulate(angle: Array, velocity: Array, count: int, terms: Array, dt: float) -> Array:
    """Angles ``(count, ...)`` of pendulums side by side, Runge-Kutta 4; dry friction is steep, not stiff, near rest."""
    g, c, f, d = terms

    def acceleration(q: Array, v: Array) -> Array:
        return g * np.sin(q) - c * v - f * np.tanh(v / 2e-3) - d * v * np.abs(v)

    q, v, half = np.array(angle, dtype=float), np.array(velocity, dtype=float), dt / 2
    out = np.empty((count, *q.shape))
    for k in range(count):
        out[k] = q
        a1 = acceleration(q, v)
        a2 = acceleration(q + half * v, v + half * a1)
        a3 = acceleration(q + half * v + half**2 * a1, v + half * a2)
        a4 = acceleration(q + dt * v + dt * half * a2, v + dt * a3)
        q, v = q + dt * v + dt**2 / 6 * (a1 + a2 + a3), v + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return out


def fit(names: str, piece: float = PIECE, dt: float = 2e-3) -> tuple[Array, float]:
    """Fit the named terms and the first state of every piece; returns all four terms and the rms of the angle [rad]."""
    angle = load_multiarm("train")["qpos.arm"].numpy()[:: round(dt / 1e-3)]
    count = round(piece / dt)
    pieces = len(angle) // count
    wanted = angle[: pieces * count].reshape(pieces, count).T
    first = (-3 * wanted[0] + 4 * wanted[1] - wanted[2]) / (2 * dt)
    places = [TERMS.index(name) for name in names]

    def parts(values: Array) -> tuple[Array, Array, Array]:
        terms = np.zeros(4)
        terms[places] = values[: len(names)]
        starts = values[len(names) :].reshape(2, pieces)
        return terms, wanted[0] + starts[0], first + starts[1]

    def residual(values: Array) -> Array:
        terms, q, v = parts(values)
        return (simulate(q, v, count, terms, dt) - wanted).ravel()

    def jacobian(values: Array) -> Array:
        return _jacobian(parts(values), places, count, dt)

    start = np.array([_START[name] for name in names] + [0.0] * 2 * pieces)
    found = least_squares(residual, start, jacobian, x_scale="jac", max_nfev=25)
    return parts(found.x)[0], rms(found.fun)


def _jacobian(state: tuple[Array, Array, Array], places: Sequence[int], count: int, dt: float) -> Array:
    """Differences of simulations side by side: one for each term, one for each half of the first states."""
    terms, q, v = state
    step, cases, pieces = 1e-6, len(places) + 3, len(q)
    many = np.tile(terms[:, None, None], (1, cases, pieces))
    angles, velocities = np.tile(q, (cases, 1)), np.tile(v, (cases, 1))
    for case, place in enumerate(places):
        many[place, case] += step
    angles[-3] += step
    velocities[-2] += step
    out = simulate(angles, velocities, count, many, dt)
    change = (out[:, :-1] - out[:, -1:]) / step
    rows = np.zeros((count, pieces, len(places) + 2 * pieces))
    rows[..., : len(places)] = change[:, : len(places)].transpose(0, 2, 1)
    each = np.arange(pieces)
    rows[:, each, len(places) + each] = change[:, -2]
    rows[:, each, len(places) + pieces + each] = change[:, -1]
    return rows.reshape(count * pieces, -1)


def free_run(simulator: Callable[[float, float, int], Array]) -> float:
    """Rms of the angle [rad] over the held-out 18.3 s, from a first state that fits the first second."""
    wanted = load_multiarm("test")["qpos.arm"].numpy()
    slope = (wanted[20] - wanted[0]) / 20e-3
    start = least_squares(lambda x: simulator(x[0], x[1], 1000) - wanted[:1000], [wanted[0], slope]).x
    return rms(simulator(start[0], start[1], len(wanted)) - wanted)


def by_terms(terms: Array) -> Callable[[float, float, int], Array]:
    """A simulator by the four terms."""
    return lambda q, v, count: simulate(np.array([q]), np.array([v]), count, terms, 1e-3)[:, 0]


def by_mjcf(path: Path) -> Callable[[float, float, int], Array]:
    """A simulator by a model file with one joint and a step of 1 ms."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)

    def run(q: float, v: float, count: int) -> Array:
        mujoco.mj_resetData(model, data)
        data.qpos[0], data.qvel[0] = q, v
        out = np.empty(count)
        for k in range(count):
            out[k] = data.qpos[0]
            mujoco.mj_step(model, data)
        return out

    return run


def authors() -> Array:
    """The four terms of the authors' calibrated model."""
    content = scipy.io.loadmat(fetch("multiarm_single/EstimatedParameters_SinglePendulum.mat"))
    distance, mass, inertia, viscous, gravity = content["EstimatedParameters"][0]
    whole = inertia + mass * distance**2
    return np.array([mass * gravity * distance, viscous, 0.0, 0.0]) / whole


def reference() -> list[str]:
    """Markdown lines: what trajectory least squares finds."""
    lines = ["| MultiArm, pieces of | terms | g, 1/s2 | c, 1/s | f, rad/s2 | d | fit, rad | held out, rad |"]
    lines.append("|---|---|---|---|---|---|---|---|")
    lines.append(f"| | authors, by Runge-Kutta | {_cells(authors())} | | {free_run(by_terms(authors())):.4f} |")
    lines.append(f"| | authors, by assets/multiarm.xml | | | | | | {free_run(by_mjcf(multiarm_model())):.4f} |")
    for piece, names in [(p, n) for p in (1.0, PIECE) for n in ("g", "gc", "gf", "gfd")] + [(1.0, "gcfd")]:
        terms, left = fit(names, piece)
        error = free_run(by_terms(terms))
        lines.append(f"| {piece:.3g} s | {names} | {_cells(terms)} | {left:.4f} | {error:.4f} |")
    return lines


def _cells(terms: Array) -> str:
    return " | ".join(f"{value:.4g}" for value in terms)


def judge(diagnosis: Mapping[str, Any], folder: Path) -> list[tuple[str, str, bool]]:
    """What was asked, what was found, and whether that holds."""
    names = [effect["name"] for effect in diagnosis["effects"]]
    found = {"coulomb_friction", "quadratic_drag"} <= set(names)
    rows = [("dry friction and quadratic drag found", ", ".join(names) or "none", found)]
    path = folder / "corrected.xml"
    error = free_run(by_mjcf(path)) if path.is_file() else float("nan")
    rows.append(("held-out free run at most 0.025 rad", f"{error:.4f}", error <= 0.025))
    return rows
