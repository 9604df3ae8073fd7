"""Effects that a wrong time step looks like: what comes late, and what servos do half a step early."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.physics.effect import Effect
from torch_activegp.physics.joint import JointEffect

LIKE_A_TIME_STEP = frozenset({"actuator_delay", "actuator_lag", "sensor_delay"})
_FEW_STEPS = 4.0
"""What comes late by fewer time steps may be a matter of these: behind steps of 5 ms a lag of 3 ms was a delay."""
_FARTHER = 1e-4
"""How far a joint is moved, rad or m, and how fast, to see stiffness and damping."""
_SLACK = 2.0
"""Times half a step that may be meant: transmissions are stiffer elsewhere than at the model's pose."""

Sets = Sequence[tuple[Sequence[Effect], Sequence[Array]]]


def like_few_steps(effects: Iterable[Effect], values: Iterable[Array], step: float) -> bool:
    """Whether some effects hold one that comes late by so few time steps, s, that these may be what is wrong."""
    pairs = zip(effects, values, strict=True)
    return any(effect.name in LIKE_A_TIME_STEP and value[0] < _FEW_STEPS * step for effect, value in pairs)


def without_delays(sets: Sets) -> list[tuple[tuple[Effect, ...], tuple[Array, ...]]]:
    """The same sets without what a wrong time step looks like."""
    out = []
    for effects, values in sets:
        kept = [(e, v) for e, v in zip(effects, values, strict=True) if e.name not in LIKE_A_TIME_STEP]
        if len(kept) < len(effects):
            out.append((tuple(e for e, _ in kept), tuple(v for _, v in kept)))
    return out


def otherwise_late(sets: Sets) -> list[tuple[tuple[Effect, ...], tuple[Array, ...]]]:
    """Those of some sets that differ from the first one only in how or where something comes late."""

    def rest(effects: Sequence[Effect]) -> frozenset[Effect]:
        return frozenset(effect for effect in effects if effect.name not in LIKE_A_TIME_STEP)

    first = sets[0][0] if sets else ()
    if len(rest(first)) == len(first):
        return []
    return [(tuple(e), tuple(v)) for e, v in sets[1:] if rest(e) == rest(first) and len(e) > len(rest(e))]


def without_half_steps(
    sets: Sets, model: mujoco.MjModel, step: float
) -> list[tuple[tuple[Effect, ...], tuple[Array, ...]]]:
    """The same sets without what may stand for half a time step.

    Integrators of first order put a control half a step early: with a servo of stiffness K that the joint follows that
    is a damping of -K h/2. And they have a damping D half a step late, which is an inertia of -D h/2. Behind servos of
    5 and 6 N m/rad in steps of 1 ms Runge-Kutta wanted two viscous frictions of -0.0025 N m s/rad.

    Args:
        sets: effects and values.
        model: whose servos and damping are meant.
        step: the longest time step that may be meant, s.
    """
    stiffness, damping = _servo_stiffness(model), _damping(model)
    most = {"viscous_friction": stiffness, "armature_error": damping}

    def meant(effect: Effect, value: Array) -> bool:
        there = most.get(effect.name)
        late = 0.0 if there is None or not isinstance(effect, JointEffect) else float(there[effect.dof])
        return late > 0.0 and abs(value[0]) <= 0.5 * _SLACK * step * late

    out = []
    for effects, values in sets:
        kept = [(e, v) for e, v in zip(effects, values, strict=True) if not meant(e, v)]
        if len(kept) < len(effects):
            out.append((tuple(e for e, _ in kept), tuple(v for _, v in kept)))
    return out


def _servo_stiffness(model: mujoco.MjModel) -> Array:
    """How much servos push a joint back that is moved from the model's pose, ``(nv,)``."""
    data, moved = mujoco.MjData(model), np.eye(model.nv)
    mujoco.mj_forward(model, data)
    still, out = data.qfrc_actuator.copy(), np.zeros(model.nv)
    for dof in range(model.nv):
        mujoco.mj_resetData(model, data)
        mujoco.mj_integratePos(model, data.qpos, moved[dof], _FARTHER)
        mujoco.mj_forward(model, data)
        out[dof] = abs(data.qfrc_actuator[dof] - still[dof]) / _FARTHER
    return out


def _damping(model: mujoco.MjModel) -> Array:
    """How much a moving joint is braked at the model's pose, by itself and its servos, ``(nv,)``."""
    data, out = mujoco.MjData(model), np.zeros(model.nv)
    mujoco.mj_forward(model, data)
    still = data.qfrc_actuator + data.qfrc_passive
    for dof in range(model.nv):
        data.qvel[:] = _FARTHER * np.eye(model.nv)[dof]
        mujoco.mj_forward(model, data)
        out[dof] = abs((data.qfrc_actuator + data.qfrc_passive - still)[dof]) / _FARTHER
    return out
