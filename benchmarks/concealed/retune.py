"""The modeller's own attempt: damping, rotor, gain and bias of the nominal fitted to the true data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from benchmarks.concealed.evaluate import Edit, Window, projected
from benchmarks.concealed.plant import A, J, Plant, copy


def _knobs(plant: Plant, servo: bool) -> list[tuple[str, int, int, float, float]]:
    """Table, row, column, scale and least value of what is tuned."""
    driven = {int(row[A.JOINT]): i for i, row in enumerate(plant.actuator)}
    rotor = np.maximum(plant.joint[:, J.ROTOR], plant.joint[:, J.VISCOUS])
    knobs = [("joint", j, J.VISCOUS, max(plant.joint[j, J.VISCOUS], 1e-4), 0.0) for j in range(len(plant.joint))]
    knobs += [("joint", j, J.ROTOR, max(rotor[j], 1e-5), 0.0) for j in driven]
    if not servo:
        knobs += [("actuator", i, A.GEAR, plant.actuator[i, A.GEAR], 0.2) for i in driven.values()]
        knobs += [("actuator", i, A.B0, plant.joint[j, J.VISCOUS] + 1e-3, -np.inf) for j, i in driven.items()]
    return knobs


def _edit(table: str, row: int, column: int) -> Edit:
    def change(plant: Plant, size: float) -> None:
        getattr(plant, table)[row, column] += size

    return change


def retune(plant: Plant, found: Sequence[Window], deviation: np.ndarray, servo: bool) -> Plant:
    """Least squares over all windows, initial states free, four Gauss-Newton steps with a weak pull to the start."""
    knobs = _knobs(plant, servo)
    tuned = copy(plant)
    for _ in range(4):
        edits = [(_edit(table, row, column), 0.02 * scale) for table, row, column, scale, _ in knobs]
        scales = np.array([knob[3] for knob in knobs])
        parts = [projected(tuned, window, deviation, edits) for window in found]
        slope = np.vstack([change for _, change in parts]) * scales
        residual = np.concatenate([rest for rest, _ in parts])
        if not np.isfinite(slope).all():
            return plant
        normal = slope.T @ slope
        move = np.linalg.solve(normal + 1e-4 * np.trace(normal) / len(knobs) * np.eye(len(knobs)), slope.T @ residual)
        for (table, row, column, scale, least), size in zip(knobs, np.clip(move, -3, 3), strict=True):
            values = getattr(tuned, table)
            values[row, column] = max(values[row, column] + size * scale, least)
    return tuned


def undone(plant: Plant, tuned: Plant, joints: Sequence[str], motors: Sequence[str]) -> list[dict[str, Any]]:
    """What leads from the tuned nominal back to the plant, in the words of the effects and of the key."""
    found = []
    for j, joint in enumerate(joints):
        for name, parameter, column in (
            ("viscous_friction", "coefficient", J.VISCOUS),
            ("armature_error", "armature", J.ROTOR),
        ):
            found.append((name, f"joint:{joint}", parameter, plant.joint[j, column] - tuned.joint[j, column]))
    for i, motor in enumerate(motors):
        now, joint = tuned.actuator[i], joints[int(tuned.actuator[i, A.JOINT])]
        found.append(("actuator_gain", f"actuator:{motor}", "gain", plant.actuator[i, A.GEAR] / now[A.GEAR]))
        force = now[A.GEAR] * (plant.actuator[i, A.B0] - now[A.B0])
        found.append(("constant_force", f"joint:{joint}", "force", force))
    return [
        {"name": name, "target": target, "parameters": {parameter: {"value": float(value)}}}
        for name, target, parameter, value in found
        if value != (1.0 if name == "actuator_gain" else 0.0)
    ]


def write_back(text: str, plant: Plant) -> str:
    """The model's text with the tuned numbers."""
    spec = mujoco.MjSpec.from_string(text)
    model = spec.compile()
    for j in range(model.njnt):
        joint = spec.joint(model.joint(j).name)
        joint.damping[0], joint.armature = plant.joint[j, J.VISCOUS], plant.joint[j, J.ROTOR]
    for i in range(model.nu):
        actuator = spec.actuator(model.actuator(i).name)
        actuator.gear[0] = plant.actuator[i, A.GEAR]
        if plant.actuator[i, A.B0] != 0 and not plant.actuator[i, A.B1]:
            actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            actuator.biasprm[0] = plant.actuator[i, A.B0]
    spec.compile()
    return spec.to_xml()
