"""mujoco.sysid with every parameter free; it names those whose 95 % interval leaves out the nominal value."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
from mujoco import sysid

from benchmarks.concealed.peers.recorded import answer, names_of, read, smooth

CHUNK = 1.0
"""Length of a roll-out, s, each from a smoothed initial state; a whole run from one state would do worse."""
MOST = 20

Write = Callable[[mujoco.MjSpec, float], None]
Knob = tuple[str, str, float, float, float, Write]
"""Name, target, nominal, least, largest, and how to write it."""


def _first(part: str, name: str, field: str) -> Write:
    """Write the first number of a vector, such as `damping[0]` or `gear[0]`."""
    return lambda spec, value: getattr(getattr(spec, part)(name), field).__setitem__(0, value)


def _scalar(name: str, field: str) -> Write:
    return lambda spec, value: setattr(spec.joint(name), field, value)


def _mass(name: str, weights: Sequence[float]) -> Write:
    def write(spec: mujoco.MjSpec, value: float) -> None:
        for geom, weight in zip(spec.body(name).geoms, weights, strict=True):
            geom.mass = value * weight

    return write


def _knobs(spec: mujoco.MjSpec, model: mujoco.MjModel) -> Iterator[Knob]:
    data, M = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, M)
    for j in range(model.njnt):
        name, size = model.joint(j).name, M[j, j]
        damping, dry, rotor, spring = (
            float(values[j])
            for values in (model.dof_damping, model.dof_frictionloss, model.dof_armature, model.jnt_stiffness)
        )
        target = f"joint:{name}"
        yield "viscous_friction", target, damping, 0.0, damping + 20 * size, _first("joint", name, "damping")
        yield "coulomb_friction", target, dry, 0.0, dry + 20 * size, _scalar(name, "frictionloss")
        yield "armature_error", target, rotor, 0.0, rotor + 2 * size, _scalar(name, "armature")
        yield "linear_spring", target, spring, 0.0, spring + 100 * size, _first("joint", name, "stiffness")
    for i in range(model.nu):
        name, gear = model.actuator(i).name, float(model.actuator_gear[i, 0])
        yield "actuator_gain", f"actuator:{name}", gear, 0.3 * gear, 3 * gear, _first("actuator", name, "gear")
    for body in range(1, model.nbody):
        name = model.body(body).name
        yield "payload_mass", f"body:{name}", 1.0, 0.3, 3.0, _mass(name, [g.mass for g in spec.body(name).geoms])


def diagnose(folder: Path) -> dict[str, Any]:
    """Fit all, and name what moved."""
    model, tables = read(folder, "train")
    spec = mujoco.MjSpec.from_file(str(folder / "model.xml"))
    parameters, knobs = sysid.ParameterDict(), list(_knobs(spec, model))
    for effect, target, value, low, high, write in knobs:
        label = f"{effect} {target}"
        modifier = lambda spec, parameter, write=write: write(spec, float(parameter.value[0]))  # noqa: E731
        parameters.add(sysid.Parameter(label, value, low, high, modifier=modifier))
    parameters.move_off_bounds(1e-3)
    chunks = [chunk for table in tables for chunk in _chunks(model, table)]
    kept = np.unique(np.linspace(0, len(chunks) - 1, MOST).astype(int))
    sequences = sysid.ModelSequences(
        "case",
        spec,
        [f"chunk{k}" for k in kept],
        *[list(part) for part in zip(*[chunks[k] for k in kept], strict=True)],
    )
    residual = sysid.build_residual_fn(models_sequences=[sequences], n_threads=1)
    start = parameters.as_vector().copy()
    with contextlib.redirect_stdout(io.StringIO()):
        fitted, result = sysid.optimize(parameters, residual, optimizer="mujoco", verbose=False, max_iters=40)
    residuals, _, _ = residual(result.x, fitted)
    _, intervals = sysid.calculate_intervals(residuals, result.jac)
    nominal = np.array([knob[2] for knob in knobs])
    moved = np.abs(result.x - nominal) > intervals + 2e-3 * np.abs(start - nominal)
    named = [(knob[0], knob[1]) for knob, out in zip(knobs, moved, strict=True) if out]
    return answer(named, bool(named), [target for _, target in named if target.startswith("joint:")])


def _chunks(model: mujoco.MjModel, table: pd.DataFrame) -> Iterator[tuple[Any, Any, Any]]:
    """Initial state, controls and readings of pieces of a run."""
    joints, actuators = names_of(model)
    step = float(np.median(np.diff(table["time"])))
    q, v, _, _ = smooth(model, table)
    edge = (int((table["time"].iloc[-1] - table["time"].iloc[0]) / step) - len(q)) // 2
    clock = table["time"].iloc[0] + step * (edge + np.arange(len(q)))
    time = table["time"].to_numpy()
    first = 0
    while clock[first] + CHUNK < clock[-1]:
        inside = (time >= clock[first] - 1e-9) & (time < clock[first] + CHUNK)
        rows = table[inside]
        start = int(np.argmin(np.abs(clock - rows["time"].iloc[0])))
        state = sysid.create_initial_state(model, q[start], v[start])
        times = rows["time"].to_numpy() - rows["time"].iloc[0]
        held = np.arange(0, times[-1] + model.opt.timestep, model.opt.timestep)  # its own way is to interpolate
        applied = rows[[f"ctrl.{name}" for name in actuators]].to_numpy()
        applied = applied[np.searchsorted(times, held + 1e-9, side="right") - 1]
        controls = sysid.TimeSeries.from_control_names(held, applied, model)
        readings = rows[[f"qpos.{joint}" for joint in joints]].to_numpy()
        sensors = sysid.TimeSeries.from_names(times, readings, model, [f"{joint}_encoder" for joint in joints])
        yield state, controls, sensors
        first += int(CHUNK / step)
