"""What all checks share: equally filtered signals of a run, least squares, and the laws that a diagnosis names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfiltfilt

from torch_activegp.data import Recording
from torch_activegp.physics.cogging import ENDINGS

Array = np.ndarray


class Signals(NamedTuple):
    """Acceleration, velocity, position and control, each ``(T,)``, all through one low-pass filter."""

    acceleration: Array
    velocity: Array
    position: Array
    control: Array


def signals(runs: Sequence[Recording], joint: str, actuator: str, cutoff: float, trim: int = 100) -> Signals:
    """Filter at ``cutoff`` Hz forwards and backwards, differentiate a spline, and join the runs; 1 kHz."""
    each = [_one(run, joint, actuator, cutoff, trim) for run in runs]
    return Signals(*(np.concatenate(parts) for parts in zip(*each, strict=True)))


def _one(run: Recording, joint: str, actuator: str, cutoff: float, trim: int) -> tuple[Array, ...]:
    raw = run.time.numpy()
    time = np.arange(raw[0], raw[-1], 1e-3)
    position = np.interp(time, raw, run[f"qpos.{joint}"].numpy())
    control = np.interp(time, raw, run[f"ctrl.{actuator}"].numpy())
    low_pass = butter(4, cutoff / 500, output="sos")
    trend = np.polyval(np.polyfit(time, position, 1), time)
    spline = CubicSpline(time, sosfiltfilt(low_pass, position - trend) + trend)
    keep = slice(trim, -trim)
    return spline(time, 2)[keep], spline(time, 1)[keep], spline(time)[keep], sosfiltfilt(low_pass, control)[keep]


def least_squares(terms: Sequence[Array], wanted: Array) -> tuple[Array, Array]:
    """Coefficients of the terms, and what they leave of ``wanted``."""
    matrix = np.stack(terms, axis=1)
    found = np.linalg.lstsq(matrix, wanted, rcond=None)[0]
    return found, wanted - matrix @ found


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def values_of(effect: Mapping[str, Any]) -> dict[str, float]:
    """The parameters of an effect of diagnosis.json, as numbers."""
    return {name: float(parameter["value"]) for name, parameter in effect["parameters"].items()}


def force(effects: Sequence[Mapping[str, Any]], gain: float) -> Callable[[Array, Array], Array]:
    """The generalised force of named effects on a machine with one joint, as a function of position and velocity.

    Args:
        effects: of diagnosis.json.
        gain: force of one unit of control, for a bias of the actuator.

    Raises:
        KeyError: for an effect that is no such force.
    """
    laws = [(_LAWS[effect["name"]], values_of(effect)) for effect in effects]

    def total(position: Array, velocity: Array) -> Array:
        return sum((law(position, velocity, p, gain) for law, p in laws), start=np.zeros_like(velocity))

    return total


def _asymmetric(v: Array, p: Mapping[str, float]) -> Array:
    if "positive_level" in p:
        return -np.where(v > 0, p["positive_level"], p["negative_level"]) * np.sign(v)
    return -np.where(v > 0, p["positive"], p["negative"]) * v


def _stribeck(v: Array, p: Mapping[str, float]) -> Array:
    return -(p["coulomb"] + (p["static"] - p["coulomb"]) * np.exp(-((v / p["velocity"]) ** 2))) * np.sign(v)


def _cogging(q: Array, p: Mapping[str, float]) -> Array:
    ends = [end for end in ENDINGS if f"amplitude{end}" in p]
    return np.sum([p[f"amplitude{end}"] * np.sin(p[f"periods{end}"] * q + p[f"phase{end}"]) for end in ends], axis=0)


_LAWS: dict[str, Callable[[Array, Array, Mapping[str, float], float], Array]] = {
    "viscous_friction": lambda q, v, p, g: -p["coefficient"] * v,
    "coulomb_friction": lambda q, v, p, g: -p["level"] * np.sign(v),
    "quadratic_drag": lambda q, v, p, g: -p["coefficient"] * v * np.abs(v),
    "stribeck_friction": lambda q, v, p, g: _stribeck(v, p),
    "asymmetric_friction": lambda q, v, p, g: _asymmetric(v, p),
    "constant_force": lambda q, v, p, g: np.full_like(v, p["force"]),
    "actuator_bias": lambda q, v, p, g: np.full_like(v, g * p["bias"]),
    "cogging": lambda q, v, p, g: _cogging(q, p),
}
