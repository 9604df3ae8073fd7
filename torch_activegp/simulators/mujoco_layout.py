"""What the numbers of a MuJoCo model mean: names, bounds, angles and quaternions of its state and action."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import mujoco

from torch_activegp.errors import ConfigurationError
from torch_activegp.physics.naming import actuator_name, joint_name
from torch_activegp.simulators.space import ActionSpace, StateSpace

Bounds = Mapping[str, tuple[float, float]]
"""``{name or start of a name before a dot: (low, high)}``, for example ``{"qvel": (-20.0, 20.0)}``."""

_INFINITE = (-math.inf, math.inf)
_JOINT = mujoco.mjtJoint
_POSITION_SUFFIX = {
    _JOINT.mjJNT_FREE: (".x", ".y", ".z", ".qw", ".qx", ".qy", ".qz"),
    _JOINT.mjJNT_BALL: (".qw", ".qx", ".qy", ".qz"),
    _JOINT.mjJNT_SLIDE: ("",),
    _JOINT.mjJNT_HINGE: ("",),
}
_VELOCITY_SUFFIX = {
    _JOINT.mjJNT_FREE: (".vx", ".vy", ".vz", ".wx", ".wy", ".wz"),
    _JOINT.mjJNT_BALL: (".wx", ".wy", ".wz"),
    _JOINT.mjJNT_SLIDE: ("",),
    _JOINT.mjJNT_HINGE: ("",),
}


def state_space(model: mujoco.MjModel, angles: Sequence[str] | None = None, bounds: Bounds | None = None) -> StateSpace:
    """The space of (qpos, qvel, act) of a model.

    Names are ``qpos.<joint>``, ``qvel.<joint>`` and ``act.<actuator>``; a free or ball joint adds ``.x .y .z`` and
    ``.qw .qx .qy .qz`` to its positions, ``.vx .vy .vz`` and ``.wx .wy .wz`` to its velocities. Positions are bounded
    by joint ranges, activations by their ranges, velocities not.

    Args:
        model: compiled model.
        angles: names of the hinge joints that live on a circle. Default: each hinge without a limit whose number of
            turns has no influence, so without a spring, a position servo, a fixed tendon or a coupling to a joint.
        bounds: bounds in place of those of the model.

    Returns:
        Space of dimension nq + nv + na.

    Raises:
        ConfigurationError: ``angles`` names no hinge of the model, or ``bounds`` no dimension of the state.
    """
    chosen = _chosen_angles(model, angles)
    names: list[str] = []
    limits: list[tuple[float, float]] = []
    quaternions: list[int] = []
    for joint in range(model.njnt):
        kind, address = _JOINT(model.jnt_type[joint]), int(model.jnt_qposadr[joint])
        names += [f"qpos.{joint_name(model, joint)}{suffix}" for suffix in _POSITION_SUFFIX[kind]]
        if kind in (_JOINT.mjJNT_FREE, _JOINT.mjJNT_BALL):
            free = kind == _JOINT.mjJNT_FREE
            limits += [_INFINITE] * (3 * free) + [(-1.0, 1.0)] * 4
            quaternions.append(address + 3 * free)
        elif joint in chosen:
            limits.append((-math.pi, math.pi))
        else:
            limits.append(_range(model.jnt_limited[joint], model.jnt_range[joint]))
    velocities = [f"qvel.{name}" for name in _velocity_names(model)]
    activations = list(_activations(model))
    names += velocities + [name for name, _ in activations]
    limits += [_INFINITE] * len(velocities) + [limit for _, limit in activations]
    low, high = _overridden(names, limits, bounds)
    return StateSpace(names, low, high, [int(model.jnt_qposadr[joint]) for joint in chosen], quaternions)


def action_space(model: mujoco.MjModel, external_force: bool = False, bounds: Bounds | None = None) -> ActionSpace:
    """The space of the controls of a model, and of generalised forces on its joints if wanted.

    Names are ``ctrl.<actuator>`` (with ``.0``, ``.1``, ... for an actuator of several inputs) and ``qfrc.<joint>``,
    with the suffixes of the velocities.

    Args:
        model: compiled model.
        external_force: append one force for each degree of freedom, N or N m.
        bounds: bounds in place of those of the model.

    Returns:
        Space of dimension nu, or nu + nv.

    Raises:
        ConfigurationError: ``bounds`` names no dimension of the action.
    """
    names = [f"ctrl.{name}" for actuator in range(model.nactuator) for name in _inputs(model, actuator)]
    limits = [_range(model.actuator_ctrllimited[index], model.actuator_ctrlrange[index]) for index in range(model.nu)]
    if external_force:
        forces = [f"qfrc.{name}" for name in _velocity_names(model)]
        names += forces
        limits += [_INFINITE] * len(forces)
    low, high = _overridden(names, limits, bounds)
    return ActionSpace(names, low, high)


def _velocity_names(model: mujoco.MjModel) -> list[str]:
    return [
        joint_name(model, joint) + suffix
        for joint in range(model.njnt)
        for suffix in _VELOCITY_SUFFIX[_JOINT(model.jnt_type[joint])]
    ]


def _inputs(model: mujoco.MjModel, actuator: int) -> list[str]:
    return _numbered(actuator_name(model, actuator), int(model.actuator_ctrlnum[actuator]))


def _activations(model: mujoco.MjModel) -> Iterator[tuple[str, tuple[float, float]]]:
    for actuator in range(model.nactuator):
        limit = _range(model.actuator_actlimited[actuator], model.actuator_actrange[actuator])
        for name in _numbered(actuator_name(model, actuator), int(model.actuator_actnum[actuator])):
            yield f"act.{name}", limit


def _numbered(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name}.{index}" for index in range(count)]


def _range(limited: bool, limits: Sequence[float]) -> tuple[float, float]:
    return (float(limits[0]), float(limits[1])) if limited else _INFINITE


def _overridden(
    names: Sequence[str], limits: Sequence[tuple[float, float]], bounds: Bounds | None
) -> tuple[list[float], list[float]]:
    limits = list(limits)
    for key, limit in (bounds or {}).items():
        matches = [index for index, name in enumerate(names) if name == key or name.startswith(f"{key}.")]
        if not matches:
            raise ConfigurationError(f"bounds: found no dimension `{key}`; the dimensions are {', '.join(names)}.")
        for index in matches:
            limits[index] = limit
    return [low for low, _ in limits], [high for _, high in limits]


def _chosen_angles(model: mujoco.MjModel, angles: Sequence[str] | None) -> list[int]:
    hinges = [joint for joint in range(model.njnt) if model.jnt_type[joint] == _JOINT.mjJNT_HINGE]
    if angles is None:
        return [joint for joint in hinges if not model.jnt_limited[joint] and not _counts_turns(model, joint)]
    by_name = {joint_name(model, joint): joint for joint in hinges}
    unknown = [name for name in angles if name not in by_name]
    if unknown:
        raise ConfigurationError(f"angles: found no hinge joint {unknown}; the hinge joints are {list(by_name)}.")
    return sorted(by_name[name] for name in angles)


def _counts_turns(model: mujoco.MjModel, joint: int) -> bool:
    """Whether a whole turn of the joint changes a force, so that the angle must not be wrapped."""
    spring = model.jnt_stiffness[joint] != 0.0 or bool(model.jnt_stiffnesspoly[joint].any())
    in_tendon = (model.wrap_type == mujoco.mjtWrap.mjWRAP_JOINT) & (model.wrap_objid == joint)
    coupled = (model.eq_type == mujoco.mjtEq.mjEQ_JOINT) & ((model.eq_obj1id == joint) | (model.eq_obj2id == joint))
    servos = any(_feels_position(model, actuator, joint) for actuator in range(model.nactuator))
    return spring or bool(in_tendon.any()) or bool(coupled.any()) or servos


def _feels_position(model: mujoco.MjModel, actuator: int, joint: int) -> bool:
    transmission = model.actuator_trntype[actuator]
    on_joint = transmission == mujoco.mjtTrn.mjTRN_JOINT or transmission == mujoco.mjtTrn.mjTRN_JOINTINPARENT
    if not on_joint or model.actuator_trnid[actuator, 0] != joint:
        return False
    # A constant gain and an affine bias without a term in the length are the only laws known to be blind to position.
    gain, bias = model.actuator_gaintype[actuator], model.actuator_biastype[actuator]
    blind_gain = gain == mujoco.mjtGain.mjGAIN_FIXED or (
        gain == mujoco.mjtGain.mjGAIN_AFFINE and model.actuator_gainprm[actuator, 1] == 0.0
    )
    blind_bias = bias == mujoco.mjtBias.mjBIAS_NONE or (
        bias == mujoco.mjtBias.mjBIAS_AFFINE and model.actuator_biasprm[actuator, 1] == 0.0
    )
    return not (blind_gain and blind_bias)
