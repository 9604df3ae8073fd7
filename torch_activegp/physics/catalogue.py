"""All effects that are tried on a model."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from torch_activegp.errors import ConfigurationError
from torch_activegp.physics.actuation import ACTUATION
from torch_activegp.physics.actuator import ActuatorEffect
from torch_activegp.physics.backlash import BACKLASH
from torch_activegp.physics.bristles import BRISTLED_FORMS
from torch_activegp.physics.effect import Array, Effect
from torch_activegp.physics.friction import FRICTION
from torch_activegp.physics.inertia import (
    ArmatureError,
    CenterOfMassOffset,
    GravityError,
    axes_of_gravity,
    pulls_of_gravity,
)
from torch_activegp.physics.joint import JointEffect
from torch_activegp.physics.motor_side import MOTOR_SIDE
from torch_activegp.physics.payload import DensityError, PayloadAlong, PayloadAside, PayloadMass
from torch_activegp.physics.place import Place
from torch_activegp.physics.play import MEMORY
from torch_activegp.physics.sensing import SENSING, SensorEffect
from torch_activegp.physics.servo import ServoSaturation
from torch_activegp.physics.soft_friction import SoftCoulombFriction
from torch_activegp.physics.springs import POSITION_FORCES
from torch_activegp.physics.springy_backlash import SPRINGY_BACKLASH

JOINT_EFFECTS: tuple[type[Effect], ...] = (*FRICTION, *POSITION_FORCES, *MEMORY, ArmatureError)
_BODY_EFFECTS = (PayloadMass, DensityError, CenterOfMassOffset)
_PLANES = ((0, 1), (0, 2), (1, 2))
_SPACE = (0, 1, 2)
_APART = 1e-3
"""From so far on, m, a point is another one than the centre of mass."""
_AXES = ((0,), (1,), (2,), *_PLANES, _SPACE)
_LISTED: tuple[type[Effect], ...] = (
    *JOINT_EFFECTS,
    *BACKLASH,
    *SPRINGY_BACKLASH,
    *MOTOR_SIDE,
    *ACTUATION,
    ServoSaturation,
    *SENSING,
    *_BODY_EFFECTS,
    GravityError,
)


def catalogue(
    model: mujoco.MjModel,
    joints: Sequence[Place],
    actuators: Sequence[Place],
    sensors: Sequence[Place],
    more: Sequence[type[Effect]] = (),
) -> list[Effect]:
    """Makes every effect of the list for every place where it can act.

    Args:
        model: compiled nominal model.
        joints: recorded joints, hinges and slides.
        actuators: actuators with a recorded control that changes.
        sensors: recorded positions; ``index`` is the channel.
        more: classes that are not on the list: joint effects, actuator effects or sensor effects.

    Returns:
        Effects; several variants may share one name and target.

    Raises:
        ConfigurationError: a further class is of another kind, its name is on the list already, or its ``at`` does not
            take a place and a model or returns something else.
    """
    on_joints: tuple[type[Effect], ...] = (
        *JOINT_EFFECTS,
        SoftCoulombFriction,
        *BRISTLED_FORMS,
        *BACKLASH,
        *SPRINGY_BACKLASH,
        *MOTOR_SIDE,
    )
    on_drives: tuple[type[Effect], ...] = (*ACTUATION, ServoSaturation)
    listed = ((joints, on_joints), (actuators, on_drives), (sensors, SENSING))
    pairs = ((place, kind) for places, kinds in listed for place in places for kind in kinds)
    effects: list[Effect] = [kind.at(place, model) for place, kind in pairs if kind.fits(place, model)]
    effects += body_effects(model)
    pulls = pulls_of_gravity(model)
    felt = set(axes_of_gravity(model))
    effects += [GravityError.along(*axes, pulls=pulls) for axes in _AXES if felt.issuperset(axes)]
    places = {JointEffect: joints, ActuatorEffect: actuators, SensorEffect: sensors}
    taken = {kind.name for kind in _LISTED}
    for kind in more:
        acts_on = _places_of(kind, places)
        if kind.name in taken:
            raise ConfigurationError(f"effects: the name {kind.name!r} of {kind.__name__} is taken. Give it another.")
        taken.add(kind.name)
        effects += [_made(kind, place, model) for place in acts_on if kind.fits(place, model)]
    return effects


def _places_of(kind: type[Effect], places: Mapping[type[Effect], Sequence[Place]]) -> Sequence[Place]:
    """Where a class of a user's can act."""
    for base, found in places.items():
        if isinstance(kind, type) and issubclass(kind, base) and hasattr(kind, "name") and _says_how(kind):
            return found
    raise ConfigurationError(
        "effects: a class wanted that is a JointEffect, an ActuatorEffect or a SensorEffect and has a name and a "
        f"method `at`, found {kind!r}. See tutorials/07_add_an_effect.py."
    )


def _says_how(kind: type[Effect]) -> bool:
    """Whether a class has an ``at`` of its own."""
    return inspect.getattr_static(kind, "at") is not inspect.getattr_static(Effect, "at")


def _made(kind: type[Effect], place: Place, model: mujoco.MjModel) -> Effect:
    """An effect of a user's class, if its ``at`` is what it should be."""
    if inspect.isfunction(inspect.getattr_static(kind, "at")):
        raise _wrong_at(kind, "a function without @classmethod")
    try:
        inspect.signature(kind.at).bind(place, model)
    except TypeError as error:
        raise _wrong_at(kind, f"one that cannot be called so: {error}") from error
    effect = kind.at(place, model)
    if not isinstance(effect, kind):
        raise _wrong_at(kind, f"one that returns {type(effect).__name__} for {place.target}")
    return effect


def _wrong_at(kind: type[Effect], found: str) -> ConfigurationError:
    return ConfigurationError(
        f"effects: a class method {kind.__name__}.at wanted that takes (place, model) and returns a {kind.__name__}, "
        f"found {found}. See tutorials/07_add_an_effect.py."
    )


def body_effects(model: mujoco.MjModel) -> list[Effect]:
    """Payloads and displaced centres of mass on every body that moves.

    MuJoCo compiles a balanced body with several joints to a mass matrix that is diagonal and stays so: to let its
    centre of mass move, compile the model with ``simple = False`` on the body.
    """
    effects: list[Effect] = []
    for body in range(1, model.nbody):
        if model.body_weldid[body] == 0 or model.body_mass[body] <= 0.0:
            continue
        stays_balanced = model.body_simple[body] == 1 and model.body_dofnum[body] > 1
        place = Place(f"body:{model.body(body).name or f'body{body}'}", body)
        effects.append(PayloadMass.at(place, model))
        effects.append(DensityError.at(place, model))
        reach = farthest_point(model, body)
        size = max(float(np.linalg.norm(reach)), 0.02)
        if stays_balanced:
            continue
        if ends := bool(np.linalg.norm(reach) > _APART):
            effects += [PayloadMass.at(place, model, reach, "end"), PayloadAlong.towards(place, model, reach)]
        radius = float(model.geom_rbound[model.geom_bodyid == body].max(initial=0.0))
        if ends or radius > _APART:  # a ball has no end, but room for a load aside
            aside = reach if ends else np.full(3, radius / np.sqrt(3.0))
            effects += [PayloadAside.within(place, model, aside, axes) for axes in (*_PLANES, _SPACE)]
        effects += [CenterOfMassOffset.along(place, size, *axes) for axes in _AXES]
    return effects


def farthest_point(model: mujoco.MjModel, body: int) -> Array:
    """The end of a body that is farthest from its joint: where a tool or a load is mounted.

    Of a body without shapes, and without sites and children away from its centre of mass, nothing but its inertia is
    known: then that of a box with the same.

    Returns:
        Offset from the body's centre of mass, m, in the body's frame, ``(3,)``.
    """
    points = [model.body_pos[child] for child in range(model.nbody) if model.body_parentid[child] == body]
    points += [model.site_pos[site] for site in range(model.nsite) if model.site_bodyid[site] == body]
    for geom in range(model.ngeom):
        if model.geom_bodyid[geom] != body:
            continue
        points += list(_ends(model, geom))
    center = model.body_ipos[body]
    if not model.body_geomnum[body] and all(np.linalg.norm(point - center) < _APART for point in points):
        points = list(_ends_of_box(model, body))
    joint = model.body_jntadr[body]
    anchor = model.jnt_pos[joint] if joint >= 0 else np.zeros(3)
    rounded = [(round(float(np.linalg.norm(point - anchor)), 6), *np.round(point, 6)) for point in points]
    return np.asarray(points[rounded.index(max(rounded))] - center, dtype=float)


def _ends_of_box(model: mujoco.MjModel, body: int) -> Array:
    """The middles of the faces of a box with a body's inertia, in the body's frame, m, ``(6, 3)``."""
    inertia = model.body_inertia[body]
    half = np.sqrt(np.maximum(1.5 * (inertia.sum() - 2.0 * inertia) / model.body_mass[body], 0.0))
    half = np.minimum(half, model.stat.extent)  # an inertia that stands for none is that of a huge box
    ends = np.concatenate([np.diag(half), -np.diag(half)])
    turned = Rotation.from_quat(model.body_iquat[body], scalar_first=True).apply(ends)
    return np.asarray(model.body_ipos[body] + turned)


_LONG = (int(mujoco.mjtGeom.mjGEOM_CAPSULE), int(mujoco.mjtGeom.mjGEOM_CYLINDER))
_ROUND = int(mujoco.mjtGeom.mjGEOM_SPHERE)


def _ends(model: mujoco.MjModel, geom: int) -> Array:
    """Where a shape ends, in the body's frame, m, ``(n, 3)``: a rod on its axis, a box at its faces, a ball nowhere."""
    kind, (centre, half) = int(model.geom_type[geom]), model.geom_aabb[geom].reshape(2, 3)
    if kind in _LONG or kind == _ROUND:
        half = np.array([0.0, 0.0, model.geom_size[geom, 1] if kind in _LONG else 0.0])
    ends = centre + np.concatenate([np.diag(half), -np.diag(half)])
    return np.asarray(model.geom_pos[geom] + Rotation.from_quat(model.geom_quat[geom], scalar_first=True).apply(ends))
