"""Recordings as the usual methods see them: smoothed states, and the force that the nominal does not explain."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from scipy.signal import butter, sosfiltfilt

CUTOFF = 8.0
"""Of the filter without phase that states and controls pass alike, Hz, as is usual in robot identification."""


@dataclasses.dataclass(frozen=True)
class Recorded:
    """All rows of one role, smoothed: q, v, a (N, n), controls u (N, m) and their rate, the force that is missing and
    the nominal's own acceleration there (N, n); independent: rows that the filter leaves.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    u: np.ndarray
    rate: np.ndarray
    residual: np.ndarray
    expected: np.ndarray
    independent: float


def names_of(model: mujoco.MjModel) -> tuple[list[str], list[str]]:
    """Joints and actuators."""
    return [model.joint(j).name for j in range(model.njnt)], [model.actuator(i).name for i in range(model.nu)]


def read(folder: Path, role: str) -> tuple[mujoco.MjModel, list[pd.DataFrame]]:
    """The model and the tables of `train` or `test`."""
    model = mujoco.MjModel.from_xml_path(str(folder / "model.xml"))
    return model, [pd.read_csv(path) for path in sorted(folder.glob(f"{role}_*.csv"))]


def smooth(model: mujoco.MjModel, table: pd.DataFrame) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """q, v, a (N, n) on an even clock, and the controls (N, m), all through one filter; 0.2 s at each end left out."""
    joints, actuators = names_of(model)
    time = table["time"].to_numpy()
    step = float(np.median(np.diff(time)))
    clock = np.arange(time[0], time[-1], step)
    q = np.column_stack([np.interp(clock, time, table[f"qpos.{joint}"]) for joint in joints])
    applied = table[[f"ctrl.{name}" for name in actuators]].to_numpy()
    sides = [applied[np.searchsorted(time, clock + shift, side="right") - 1] for shift in (1e-9, 1e-9 - step / 2)]
    low_pass = butter(4, CUTOFF, fs=1 / step, output="sos")
    q, u = (sosfiltfilt(low_pass, signal, axis=0) for signal in (q, sum(sides) / 2))
    v = np.gradient(q, step, axis=0)
    a = np.zeros_like(q)
    a[1:-1] = np.diff(q, 2, axis=0) / step**2
    inner = slice(int(0.2 / step), len(clock) - int(0.2 / step))
    return q[inner], v[inner], a[inner], u[inner]


def load(folder: Path, role: str = "train", most: int = 6000) -> tuple[mujoco.MjModel, Recorded]:
    """Smooth all runs of a role and compute the force that is missing; at most so many rows, evenly."""
    model, tables = read(folder, role)
    parts: Sequence[Any] = [smooth(model, table) for table in tables]
    rates = [np.gradient(part[3], float(np.median(np.diff(table["time"]))), axis=0)
             for part, table in zip(parts, tables, strict=True)]  # fmt: skip
    q, v, a, u = (np.vstack([part[k] for part in parts]) for k in range(4))
    rows = np.unique(np.linspace(0, len(q) - 1, min(most, len(q))).astype(int))
    q, v, a, u, rate = q[rows], v[rows], a[rows], u[rows], np.vstack(rates)[rows]
    forces = missing_force(model, q, v, a, u), nominal_acceleration(model, q, v, u)
    seconds = sum(
        len(part[0]) * float(np.median(np.diff(table["time"]))) for part, table in zip(parts, tables, strict=True)
    )
    independent = 2 * CUTOFF * seconds
    return model, Recorded(q, v, a, u, rate, *forces, independent)


def missing_force(model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, a: np.ndarray, u: np.ndarray) -> np.ndarray:
    """What inverse dynamics asks for beyond the motors' torque, (N, n)."""
    data, residual = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.qacc[:], data.ctrl[:] = q[k], v[k], a[k], u[k]
        mujoco.mj_inverse(model, data)
        needed = data.qfrc_inverse.copy()
        mujoco.mj_fwdActuation(model, data)
        residual[k] = needed - data.qfrc_actuator
    return residual


def nominal_acceleration(model: mujoco.MjModel, q: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """What the nominal does there, (N, n): an acceleration without the noise of the measured one."""
    data, acceleration = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(q)):
        data.qpos[:], data.qvel[:], data.ctrl[:] = q[k], v[k], u[k]
        mujoco.mj_forward(model, data)
        acceleration[k] = data.qacc
    return acceleration


def answer(effects: Sequence[tuple[str, str]], detected: bool, places: Sequence[str] = ()) -> dict[str, Any]:
    """The contract's words for a list of names and targets."""
    verdict = "named" if effects else "unknown" if detected else "none"
    return {
        "schema_version": 1,
        "verdict": verdict,
        "mismatch": {"detected": detected},
        "location": [{"target": place} for place in places],
        "effects": [{"name": name, "target": target} for name, target in effects],
    }
