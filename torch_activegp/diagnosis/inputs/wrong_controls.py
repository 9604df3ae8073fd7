"""Controls whose sign or unit is doubtful beside all else that may be missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run, input_addresses
from torch_activegp.diagnosis.inputs.wrong_units import Motion, balance

_UNITS = (-3, -2, 2, 3)
"""Powers of ten by which units of a control are apart."""
_SERVO_UNITS: tuple[dict[str, float], ...] = ({}, {"deg": np.pi / 180}, {"deg/s": np.pi / 180, "rpm": np.pi / 30})
"""Units that commands of a hinge's motors are taken for SI in: of forces, of places, of speeds."""
_NEAR = 1.25
"""Factor by which a control may be off its unit or sign and still seem to be of that one."""
_SURE = 0.1
"""Standard error of a factor, in parts of it, above which nothing is said."""
_EXPLAINED = 0.9
"""Part of the lacking force that the control and what stands for other effects must explain."""
_LACKS = 0.3
"""Forces that the model lacks on a joint, over those that it has, from which a control is doubted."""


def doubt_controls(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run]) -> list[str]:
    """Says which controls seem to have the other sign, or another unit.

    One that is a hundred or a thousand times too large or small, or a servo's command in degrees or rpm.

    The forces that the model lacks on a joint are regressed on those of each control there, beside a constant, a
    spring, weight, dry and viscous friction (not inertia: with it, any factor fits): so a flipped sign shows where a
    spring is missing too. No gain on the list of effects is negative, so none undoes a sign; what comes closest would
    be sought for long, in vain.

    Args:
        model: nominal.
        channels: the recorded joints.
        runs: for fitting.

    Returns:
        Sentences; none where the motion of some joints is prescribed, and where noise hides accelerations.
    """
    balanced = balance(model, channels, runs)
    if balanced is None:
        return []
    ratio, inputs = balanced.missing / balanced.there, input_addresses(model)
    doubts: dict[str, str] = {}
    for joint in np.argsort(-ratio):
        if ratio[joint] < _LACKS:
            break
        pushes = _pushes(model, channels, balanced.motion, list(inputs.values()), joint)
        acting = [i for i, push in enumerate(pushes.T) if push.std() > 0.0]
        found = _factors(balanced.motion, pushes[:, acting], balanced.lacking[:, joint], joint)
        names = [list(inputs)[i] for i in acting]
        actuators = np.flatnonzero(model.actuator_ctrlnum > 0)[acting]
        for name, actuator, factor in zip(names, actuators, found, strict=True):
            if text := _doubt(name, factor, _SERVO_UNITS[servo_order(model, int(actuator))]):
                doubts.setdefault(name, text)
    return list(doubts.values())


def servo_order(model: mujoco.MjModel, actuator: int) -> int:
    """What an actuator leads a hinge to: 1 a place, 2 a speed, 0 neither.

    Its force is proportional to how far that is from its command: a motor's back-EMF is another part of a speed.
    """
    joint, hinge = int(model.actuator_trnid[actuator, 0]), int(mujoco.mjtJoint.mjJNT_HINGE)
    on_joint = int(model.actuator_trntype[actuator]) == int(mujoco.mjtTrn.mjTRN_JOINT)
    affine = int(model.actuator_biastype[actuator]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    if not (on_joint and affine and int(model.jnt_type[joint]) == hinge):
        return 0
    gain, bias = float(model.actuator_gainprm[actuator, 0]), model.actuator_biasprm[actuator]
    order = next((order for order in (1, 2) if bias[order] != 0.0), 0)
    return order if order and np.isclose(gain, -bias[order]) else 0


def _doubt(name: str, factor: float, units: Mapping[str, float]) -> str:
    """What seems to be wrong with a control of which so many times its force moves the machine.

    Args:
        name: of the actuator.
        factor: that many times.
        units: in which its command may be, and their factors.
    """
    unit = next((unit for unit, size in units.items() if 1.0 / _NEAR < factor / size < _NEAR), None)
    power = next((p for p in _UNITS if 1.0 / _NEAR < factor / 10.0**p < _NEAR), None)
    if -_NEAR < factor < -1.0 / _NEAR:
        mend, what = "sign = -1", "the sign seems to be the other way round"
        also = "or without that where it is there"
    elif unit is not None:
        mend, what = f'unit = "{unit}"', f"the unit seems to be {unit}"
        also = "in place of any unit there"
    elif power is not None:
        mend, what = f"scale = 1e{power}", "the unit seems to be another one"
        also = "times any scale there; or the positions' unit is the wrong one"
    else:
        return ""
    column = f"ctrl.{name}"
    return (
        f"Column `{column}`: {what}. The machine moves as if {factor:.3g} times its force acted, whatever else is "
        f'missing. If so, say it in its line of a column map (--columns MAP.toml): {column} = {{ column = "...", '
        f"{mend} }}, {also}."
    )


def _factors(motion: Motion, pushes: Array, lacking: Array, c: int) -> Array:
    """By how much of each push ``(T, I)`` a joint is moved, ``(I,)``; NaN where that is not sure."""
    q, v = motion.position[:, c], motion.velocity[:, c]
    others = np.stack([np.ones_like(q), q, np.sin(q), np.cos(q), v, np.sign(v)], axis=1)
    design = np.concatenate([pushes, others], axis=1)
    design = design / np.maximum(np.sqrt((design**2).mean(axis=0)), 1e-300)
    size = np.sqrt((pushes**2).mean(axis=0))
    solution, _, rank, _ = np.linalg.lstsq(design, lacking, rcond=1e-8)
    rest = lacking - design @ solution
    if rank < design.shape[1] or rest.var() > (1.0 - _EXPLAINED) * (lacking**2).mean():
        return np.full(pushes.shape[1], np.nan)
    spread = np.sqrt(np.diag(np.linalg.inv(design.T @ design)) * rest.var())
    count = pushes.shape[1]
    factor, error = 1.0 + solution[:count] / size, spread[:count] / size
    return np.where(error < _SURE * np.abs(factor), factor, np.nan)


def _pushes(model: mujoco.MjModel, channels: Channels, motion: Motion, inputs: Sequence[int], c: int) -> Array:
    """The force of each control alone on a joint, ``(T, I)``, N m or N."""
    data = mujoco.MjData(model)
    out = np.zeros((len(motion.position), len(inputs)))
    for row in range(len(out)):
        data.qpos[:] = model.qpos0
        data.qpos[channels.qpos] = motion.position[row]
        data.qvel[:] = 0.0
        data.qvel[channels.dof] = motion.velocity[row]
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        forces = []
        for address in (None, *inputs):
            data.ctrl[:] = 0.0
            if address is not None:
                data.ctrl[address] = motion.control[row, address]
            mujoco.mj_fwdActuation(model, data)
            forces.append(float(data.qfrc_actuator[channels.dof[c]]))
        out[row] = np.array(forces[1:]) - forces[0]
    return out
