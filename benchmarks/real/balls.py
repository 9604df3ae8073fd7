"""Balls: free fall, linear and quadratic drag by trajectory least squares."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.real.regression import rms
from torch_activegp.data import load_balls
from torch_activegp.data.balls import BALLS, DROPS

GRAVITY = 9.81
HEAVY = ("baseball", "golf_ball", "bowling_ball")
"""Balls on which drag cannot be resolved."""
DRAG = {"viscous_friction", "quadratic_drag"}
Array = np.ndarray


def height(time: Array, start: float, speed: float, power: int, drag: float) -> Array:
    """Height [m] of a ball under gravity and ``-drag v |v|^(power - 1)`` per kg, Runge-Kutta 4 in ten steps a row."""
    q, v = start, speed
    out = np.empty_like(time)
    out[0] = q

    def acceleration(v: float) -> float:
        return -GRAVITY - drag * v * abs(v) ** (power - 1)

    for k, step in enumerate(np.diff(time) / 10, start=1):
        for _ in range(10):
            a1 = acceleration(v)
            a2 = acceleration(v + step / 2 * a1)
            a3 = acceleration(v + step / 2 * a2)
            a4 = acceleration(v + step * a3)
            q, v = q + step * v + step**2 / 6 * (a1 + a2 + a3), v + step / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        out[k] = q
    return out


def fit(ball: str, drop: int, power: int) -> tuple[float, float, float]:
    """Drag per kg, its standard error (as if the errors were white), and the rms [m]; power 0 is free fall."""
    recording = load_balls(ball, drop)
    time, wanted = recording.time.numpy(), recording["qpos.height"].numpy()

    def residual(x: Array) -> Array:
        return height(time, x[0], x[1], max(power, 1), x[2] if power else 0.0) - wanted

    found = least_squares(residual, [wanted[0], 0.0, 0.01][: 3 if power else 2])
    left = rms(found.fun)
    if not power:
        return 0.0, 0.0, left
    covariance = np.linalg.inv(found.jac.T @ found.jac) * left**2
    return float(found.x[2]), float(np.sqrt(covariance[2, 2])), left


def noise(ball: str, drop: int) -> float:
    """Standard deviation [m] of white noise with the third differences of the heights."""
    wanted = load_balls(ball, drop)["qpos.height"].numpy()
    return float(np.median(np.abs(np.diff(wanted, 3))) / 0.6745 / np.sqrt(20))


def reference() -> list[str]:
    """Markdown lines: what trajectory least squares finds."""
    lines = ["| ball, drop | noise, m | free fall, m | quadratic, m | drag / m, 1/m | linear, m | drag / m, 1/s |"]
    lines.append("|---|---|---|---|---|---|---|")
    for ball in BALLS:
        for drop in DROPS:
            fall, (c, c_error, left), (b, b_error, linear) = (fit(ball, drop, power) for power in (0, 2, 1))
            cells = f"{noise(ball, drop):.3f} | {fall[2]:.3f} | {left:.3f} | {c:.4f} +- {c_error:.4f}"
            lines.append(f"| {ball}, {drop} | {cells} | {linear:.3f} | {b:.4f} +- {b_error:.4f} |")
    return lines


def judge(diagnoses: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str, bool]]:
    """What was asked, what was found on each ball, and whether that holds."""
    rows = []
    for ball, diagnosis in diagnoses.items():
        names = [effect["name"] for effect in diagnosis["effects"]]
        asked = "nothing" if ball in HEAVY else "drag"
        right = not names if ball in HEAVY else bool(names) and set(names) <= DRAG
        rows.append((f"{ball}: {asked}", ", ".join(names) or diagnosis["verdict"], right))
    return rows
