"""What a change of inertia or gravity does, as forces: the equation of motion is linear in both."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.physics.effect import Effect, field_of

_INERTIAL = ("body_mass", "body_ipos", "body_inertia", "body_iquat")
_FOLLOWING = "body_simple"
_GRAVITY = "opt.gravity"


class Change(NamedTuple):
    """What an effect changes.

    Args:
        bodies: by the id of each that it changes, its mass, kg, first moment about its origin, kg m, ``(3,)``, and
            inertia about its origin, kg m2, ``(3, 3)``, each less those of the model, in the body's frame.
        gravity: change of gravity, m/s2, ``(3,)``.
    """

    bodies: dict[int, tuple[float, Array, Array]]
    gravity: Array


class _Motion(NamedTuple):
    """How one body moves at N instants, in its own frame.

    Args:
        linear: Jacobian of its origin, ``(N, 3, nv)``.
        angular: Jacobian of its turning, ``(N, 3, nv)``.
        turning: angular velocity, rad/s, ``(N, 3)``.
        spinning: angular acceleration, rad/s2, ``(N, 3)``.
        rising: acceleration of its origin less gravity, as a load feels it, m/s2, ``(N, 3)``.
    """

    linear: Array
    angular: Array
    turning: Array
    spinning: Array
    rising: Array


def with_effects(model: mujoco.MjModel, effects: Sequence[Effect], values: Sequence[Array]) -> mujoco.MjModel:
    """A copy of a model into which effects are written, each with values ``(P,)``, as far as they change it."""
    edited = copy.copy(model)
    for effect, its in zip(effects, values, strict=True):
        effect.edit(
            lambda name: np.asarray(field_of(edited, name))[None], np.array([0]), np.asarray(its, dtype=float)[None]
        )
    mujoco.mj_setConst(edited, mujoco.MjData(edited))
    return edited


def change(model: mujoco.MjModel, effect: Effect, values: Array) -> Change | None:
    """What an effect with values ``(P,)`` changes; None where it does anything but change inertia or gravity."""
    more = any(getattr(type(effect), hook) is not getattr(Effect, hook) for hook in ("steady", "control", "measure"))
    if effect.needs_steps or more or model.body_gravcomp.any():
        return None
    fields: dict[str, Array] = {}

    def field(name: str) -> Array:
        return fields.setdefault(name, np.array(field_of(model, name))[None])

    effect.edit(field, np.array([0]), np.asarray(values, dtype=float)[None])
    if not fields or not set(fields) <= {*_INERTIAL, _FOLLOWING, _GRAVITY}:
        return None
    before = {name: getattr(model, name) for name in _INERTIAL}
    after = {name: fields[name][0] if name in fields else own for name, own in before.items()}
    changed = [(after[name] != before[name]).reshape(model.nbody, -1).any(axis=1) for name in _INERTIAL]
    bodies = {}
    for body in map(int, np.flatnonzero(np.any(changed, axis=0))):
        ends = (_moments(*(some[name][body] for name in _INERTIAL)) for some in (after, before))
        mass, moment, inertia = (one - other for one, other in zip(*ends, strict=True))
        bodies[body] = (mass, moment, inertia)
    gravity = fields[_GRAVITY][0] - model.opt.gravity if _GRAVITY in fields else np.zeros(3)
    return Change(bodies, gravity)


def inertial_forces(
    model: mujoco.MjModel, position: Array, velocity: Array, acceleration: Array, changes: Sequence[Change]
) -> Array:
    """Generalised forces on the unchanged machine that move it as changes of its inertia would.

    Reference: Atkeson, An, Hollerbach, *Estimation of Inertial Parameters of Manipulator Loads and Links*, Int. J. of
    Robotics Research 5 (1986), eq. 10.

    Args:
        model: the machine.
        position: at N instants, rad or m, ``(N, nq)``.
        velocity: rad/s or m/s, ``(N, nv)``.
        acceleration: rad/s2 or m/s2, ``(N, nv)``.
        changes: A of them.

    Returns:
        N m or N, ``(N, nv, A)``.
    """
    bodies = sorted({body for one in changes for body in one.bodies})
    weighs = not model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    falls = weighs and any(one.gravity.any() for one in changes)
    motions, center = _moving(model, (position, velocity, acceleration), bodies, falls)
    out = np.zeros((len(position), model.nv, len(changes)))
    weight = float(model.body_subtreemass[0])
    for i, one in enumerate(changes):
        for body, (mass, moment, inertia) in one.bodies.items():
            linear, angular, turning, spinning, rising = motions[body]
            force = mass * rising + np.cross(spinning, moment) + np.cross(turning, np.cross(turning, moment))
            torque = spinning @ inertia + np.cross(turning, turning @ inertia) + np.cross(moment, rising)
            out[..., i] -= np.einsum("nxv,nx->nv", linear, force) + np.einsum("nxv,nx->nv", angular, torque)
        if falls and one.gravity.any():
            out[..., i] += weight * np.einsum("nxv,x->nv", center, one.gravity)
    return out


def _moving(
    model: mujoco.MjModel, along: tuple[Array, Array, Array], bodies: Sequence[int], falls: bool
) -> tuple[dict[int, _Motion], Array]:
    """Motion of some bodies, and, where asked, the Jacobian of the whole machine's centre of mass, ``(N, 3, nv)``."""
    position, velocity, acceleration = along
    count, nv, kind = len(position), model.nv, mujoco.mjtObj.mjOBJ_XBODY
    jacobians = np.zeros((len(bodies), 2, count, 3, nv))
    frames = np.zeros((len(bodies), count, 3, 3))
    moving = np.zeros((len(bodies), 2, count, 6))
    center = np.zeros((count, 3, nv))
    data = mujoco.MjData(model)
    for n in range(count):
        data.qpos[:], data.qvel[:], data.qacc[:] = position[n], velocity[n], acceleration[n]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        if falls:
            mujoco.mj_jacSubtreeCom(model, data, center[n], 0)
        for b, body in enumerate(bodies):
            mujoco.mj_jacBody(model, data, jacobians[b, 0, n], jacobians[b, 1, n], body)
            mujoco.mj_objectVelocity(model, data, kind, body, moving[b, 0, n], 1)
            mujoco.mj_objectAcceleration(model, data, kind, body, moving[b, 1, n], 1)
            frames[b, n] = data.xmat[body].reshape(3, 3)
    out = {}
    for b, body in enumerate(bodies):
        linear, angular = (np.einsum("nwx,nwv->nxv", frames[b], some) for some in jacobians[b])
        speed, faster = moving[b]
        out[body] = _Motion(linear, angular, speed[:, :3], faster[:, :3], faster[:, 3:])
    return out, center


def _moments(mass: float, center: Array, inertia: Array, axes: Array) -> tuple[float, Array, Array]:
    """Mass, first moment and inertia of a body about its origin, in its own frame."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, axes)
    principal = turn.reshape(3, 3)
    about = principal @ np.diag(inertia) @ principal.T
    return float(mass), mass * center, about + mass * (center @ center * np.eye(3) - np.outer(center, center))
