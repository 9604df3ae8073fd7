"""A machine with a secret: a pendulum whose recordings hold one effect, or none, that its model leaves out.

The truth is integrated here, from its equation of motion; nothing of what the diagnosis tries is used.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from torch_activegp.experiments.output import write_table, write_text

MASS, LENGTH, INERTIA, DAMPING, GRAVITY = 1.0, 0.25, 0.1, 0.05, 9.81
"""kg; m from the pivot to the centre of mass; kg m^2 about the pivot; N m s/rad; m/s^2."""
TORQUE = 1.5
"""Largest torque of the motor, N m."""
RUNS, TESTS, SECONDS, RATE, NOISE = 6, 2, 4.0, 100, 5e-4
"""Recordings to diagnose; held out; s each; Hz; rad."""
MODEL = f"""<mujoco model="pendulum">
  <option timestep="0.005" integrator="RK4"/>
  <worldbody>
    <body name="rod">
      <joint name="pivot" type="hinge" axis="0 1 0" damping="{DAMPING}"/>
      <inertial pos="0 0 {-LENGTH}" mass="{MASS}" diaginertia="{INERTIA - MASS * LENGTH**2} 0.0375 0.001"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor" joint="pivot"/>
  </actuator>
</mujoco>
"""
_STEPS = 20
_PIVOT, _MOTOR = "joint:pivot", "actuator:motor"


@dataclasses.dataclass(frozen=True)
class Secret:
    """What the model leaves out.

    Args:
        name: the effect's name; ``none`` for nothing.
        target: where it acts.
        parameter: the name of its parameter.
        value: the true value.
        unit: SI unit.
    """

    name: str
    target: str = ""
    parameter: str = ""
    value: float = 0.0
    unit: str = ""

    def __str__(self) -> str:
        if self.name == "none":
            return "nothing"
        unit = "" if self.unit == "1" else f" {self.unit}"
        return f"{self.name} at {self.target}, {self.parameter} {self.value:.4g}{unit}"


@dataclasses.dataclass(frozen=True)
class _Choice:
    """An effect with the range that its value is drawn from: a few per cent of the forces at work."""

    name: str
    target: str
    parameter: str
    unit: str
    low: float
    high: float


CHOICES = (
    _Choice("none", "", "", "", 0.0, 0.0),
    _Choice("viscous_friction", _PIVOT, "coefficient", "N m s/rad", 0.006, 0.015),
    _Choice("coulomb_friction", _PIVOT, "level", "N m", 0.02, 0.05),
    _Choice("quadratic_drag", _PIVOT, "coefficient", "N m s2/rad2", 0.002, 0.005),
    _Choice("linear_spring", _PIVOT, "stiffness", "N m/rad", 0.03, 0.08),
    _Choice("constant_force", _PIVOT, "force", "N m", 0.02, 0.05),
    _Choice("actuator_gain", _MOTOR, "gain", "1", 0.94, 0.97),
    _Choice("actuator_delay", _MOTOR, "seconds", "s", 0.006, 0.015),
    _Choice("actuator_saturation", _MOTOR, "limit", "1", 0.95, 1.1),
)


def conceal(rng: np.random.Generator) -> Secret:
    """Draws a secret."""
    choice = CHOICES[rng.integers(len(CHOICES))]
    value = float(rng.uniform(choice.low, choice.high))
    return Secret(choice.name, choice.target, choice.parameter, value, choice.unit)


def record(secret: Secret, rng: np.random.Generator) -> pd.DataFrame:
    """One recording of the true machine under a random multisine, held over each sample.

    Returns:
        Columns ``time``, ``qpos.pivot`` with noise, ``ctrl.motor``.
    """
    time = np.arange(round(SECONDS * RATE) + 1) / RATE
    frequency, phase = rng.uniform(0.2, 2.5, 5), rng.uniform(0.0, 2 * np.pi, 5)
    control = TORQUE * np.sin(2 * np.pi * np.outer(time, frequency) + phase) @ rng.dirichlet(np.ones(5))
    control *= TORQUE * rng.uniform(0.6, 1.0) / np.abs(control).max()
    start = rng.uniform(-1.0, 1.0, 2)
    angle = integrate(secret, control, (float(start[0]), float(start[1])))
    return pd.DataFrame(
        {"time": time, "qpos.pivot": angle + NOISE * rng.standard_normal(len(time)), "ctrl.motor": control}
    )


def integrate(secret: Secret, control: np.ndarray, start: tuple[float, float]) -> np.ndarray:
    """The pendulum's equation of motion, in steps of 0.5 ms.

    Args:
        secret: what acts besides weight, damping and motor.
        control: torque asked of the motor in each sample, ``(K + 1,)``, N m.
        start: angle and speed, rad and rad/s.

    Returns:
        Angles, ``(K + 1,)``, rad.
    """
    true = {choice.name: 0.0 for choice in CHOICES} | {secret.name: secret.value}
    gain, limit = true["actuator_gain"] or 1.0, true["actuator_saturation"] or math.inf
    late, part = divmod(true["actuator_delay"] * RATE * _STEPS, 1.0)
    motor = [gain * min(max(float(u), -limit), limit) for u in control]
    q, v = start
    angles = [q]
    for step in range((len(control) - 1) * _STEPS):
        before, now = (motor[max(step - int(late) - more, 0) // _STEPS] for more in (1, 0))
        q, v = _advance(true, part * before + (1.0 - part) * now, (q, v), 1.0 / (RATE * _STEPS))
        if (step + 1) % _STEPS == 0:
            angles.append(q)
    return np.array(angles)


def _advance(true: Mapping[str, float], motor: float, state: tuple[float, float], h: float) -> tuple[float, float]:
    """One step; dry friction opposes the motion that it begins with, and a step that would turn round is cut there.

    At rest the pendulum stays while the other torques are below the level of the friction.
    """
    q, v = state
    level = true["coulomb_friction"]
    there = _torque(true, motor, q, 0.0)
    if v == 0.0 and abs(there) <= level:
        return q, 0.0
    motor -= math.copysign(level, v or there)
    q1, v1 = _runge_kutta(true, motor, state, h)
    if not level or v * v1 >= 0.0:
        return q1, v1
    turn = h * v / (v - v1)
    q1, _ = _runge_kutta(true, motor, state, turn)
    return _advance(true, motor + math.copysign(level, v), (q1, 0.0), h - turn)


def _runge_kutta(true: Mapping[str, float], motor: float, state: tuple[float, float], h: float) -> tuple[float, float]:
    """One step of the fourth order."""
    q, v = state
    a1 = _torque(true, motor, q, v) / INERTIA
    a2 = _torque(true, motor, q + h / 2 * v, v + h / 2 * a1) / INERTIA
    a3 = _torque(true, motor, q + h / 2 * v + h * h / 4 * a1, v + h / 2 * a2) / INERTIA
    a4 = _torque(true, motor, q + h * v + h * h / 2 * a2, v + h * a3) / INERTIA
    return q + h * v + h * h / 6 * (a1 + a2 + a3), v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)


def _torque(true: Mapping[str, float], motor: float, q: float, v: float) -> float:
    """All torques but dry friction, N m."""
    weight = MASS * GRAVITY * LENGTH * math.sin(q) + true["linear_spring"] * q
    drag = (DAMPING + true["viscous_friction"] + true["quadratic_drag"] * abs(v)) * v
    return motor + true["constant_force"] - weight - drag


def write_demo(folder: Path, seed: int) -> Secret:
    """Writes ``model.xml``, ``run1.csv`` ... and ``test1.csv`` ... into a folder, which must exist.

    Args:
        folder: where to write.
        seed: decides on the secret, its size, the controls and the noise.

    Returns:
        The secret; no file holds it.
    """
    rng = np.random.default_rng(seed)
    secret = conceal(rng)
    write_text(folder / "model.xml", MODEL)
    for name, count in (("run", RUNS), ("test", TESTS)):
        for number in range(1, count + 1):
            write_table(folder / f"{name}{number}.csv", record(secret, rng).round(9))
    return secret


def score(secret: Secret, found: Mapping[str, Any]) -> str:
    """How right a diagnosis is, in one sentence.

    Args:
        secret: the truth.
        found: what ``diagnosis.json`` holds.
    """
    verdict, effects = found["verdict"], found.get("effects") or []
    if secret.name == "none":
        return "Right." if verdict == "none" else "Wrong: a false alarm."
    if verdict == "none":
        return "Wrong: the effect was missed."
    if verdict == "unknown":
        return "Half right: it saw that something is missing, and did not name it."
    key = (secret.name, secret.target)
    named = [(effect["name"], effect["target"]) for effect in effects]
    tied = [(tie["name"], tie["target"]) for effect in effects for tie in effect.get("ties") or ()]
    if named == [key]:
        return "Right." if not tied else "Right, and it says what these recordings cannot tell from it."
    if key in named:
        return "Half right: it names more than there is."
    if key in tied and len(named) == 1:
        return "Right up to a tie: it is among those that these recordings cannot tell apart."
    return "Wrong: it names something else."
