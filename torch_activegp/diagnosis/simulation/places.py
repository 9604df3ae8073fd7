"""Where effects can act on a machine, and how large things are there."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run, median_step
from torch_activegp.diagnosis.simulation.prescribed_motion import only_on
from torch_activegp.diagnosis.simulation.touching import now_and_then, poses_that_touch
from torch_activegp.physics import Effect, Place, catalogue
from torch_activegp.physics.body import BodyEffect
from torch_activegp.physics.naming import actuator_name
from torch_activegp.physics.servo import ServoLaw

_BACK = 0.02
"""Part of the whole range by which a joint turns back within a run: the smallest slip that is tried first."""
_ERRORS = 6.0
"""Times its noise by which a joint goes somewhere."""
_ITS_OWN = 0.5
"""Part of the poses in which something touches that lie beyond an end at which a joint makes it touch."""
_MOVING, _OFTEN = 0.1, 0.01
"""Part of the typical speed from which on a joint moves, and part of the rows in which it does."""


def effects_for(
    model: mujoco.MjModel, channels: Channels, runs: Sequence[Run], more: Sequence[type[Effect]] = ()
) -> list[Effect]:
    """All effects of the catalogue on this machine, sized by what the recordings show.

    Args:
        model: nominal model.
        channels: recorded joints.
        runs: recordings to size by.
        more: classes that are not on the list.

    Raises:
        ConfigurationError: one of these classes is of no kind that can be placed, or its name is taken.
    """
    free = _free(model, channels, runs)
    joints = [_joint(model, channels, runs, c, free[c]) for c in range(len(channels.joints))]
    sensors = [
        Place(p.target, c, p.position_unit, p.force_unit, p.position, p.speed, p.top_speed, p.force, dt=p.dt)
        for c, p in enumerate(joints)
    ]
    effects = catalogue(model, joints, _actuators(model, channels, runs), sensors, more)
    moved = _moved(model, channels)
    return [effect for effect in effects if not isinstance(effect, BodyEffect) or moved[effect.body]]


def _free(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run]) -> Array:
    """The range of each channel beyond which the model touched something in all poses, ``(C, 2)``; it may be all."""
    poses, touches = poses_that_touch(model, channels, runs)
    ends = np.array([[-np.inf, np.inf]] * poses.shape[1])
    if not now_and_then(touches):
        return ends
    low, high = poses[~touches].min(axis=0), poses[~touches].max(axis=0)
    for side, beyond in enumerate((poses < low, poses > high)):
        own = beyond.sum(axis=0) > _ITS_OWN * touches.sum()  # else the contact is another joint's
        ends[own, side] = (low, high)[side][own]
    return ends


def _joint(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run], c: int, free: Array) -> Place:
    velocity = np.concatenate([run.velocity[:, c] for run in runs])
    position = np.concatenate([run.smooth[:, c] for run in runs])
    acceleration = np.concatenate([np.gradient(run.velocity[:, c], run.time) for run in runs])
    dof, hinge = int(channels.dof[c]), bool(channels.hinge[c])
    inertia = 1.0 / max(float(model.dof_invweight0[dof]), 1e-12)
    speed = max(float(np.sqrt((velocity**2).mean())), 1e-6)
    return Place(
        f"joint:{channels.joints[c]}",
        dof,
        "rad" if hinge else "m",
        "N m" if hinge else "N",
        (float(position.min()), float(position.max())),
        speed,
        max(float(np.quantile(np.abs(velocity), 0.99)), 1e-6),
        max(
            inertia * float(np.sqrt((np.clip(acceleration, *np.quantile(acceleration, [0.01, 0.99])) ** 2).mean())),
            1e-9,
        ),
        dt=median_step(runs),
        qpos=int(channels.qpos[c]),
        loss=float(model.dof_frictionloss[dof]),
        turns_back=any(min(_travel(run, c)) > _BACK * np.ptp(position) for run in runs),
        noise=float(np.median([run.noise[c] for run in runs])),
        free=(float(free[0]), float(free[1])),
        both_ways=all(_goes(runs, c, direction * _MOVING * speed) for direction in (1.0, -1.0)),
    )


def _travel(run: Run, c: int) -> tuple[float, float]:
    """How far a channel ever goes up in a run, and down, beyond its recorder's errors."""
    position, errors = run.smooth[:, c], _ERRORS * run.noise[c]
    up = float((position - np.minimum.accumulate(position)).max())
    down = float((np.maximum.accumulate(position) - position).max())
    return max(up - errors, 0.0), max(down - errors, 0.0)


def _goes(runs: Sequence[Run], c: int, speed: float) -> bool:
    """Whether a channel goes in the direction of a speed, faster than that, in some of the rows of all runs."""
    far = [run for run in runs if _travel(run, c)[int(speed < 0.0)] > 0.0]
    rows = sum(int((run.velocity[:, c] * np.sign(speed) > abs(speed)).sum()) for run in far)
    return rows > _OFTEN * sum(map(len, runs))


def _moved(model: mujoco.MjModel, channels: Channels) -> NDArray[np.bool_]:
    """The bodies that a joint moves whose motion is not prescribed, ``(nbody,)``."""
    free = np.ones(model.nv, dtype=bool)
    if channels.prescribed is not None:
        free[channels.prescribed.dof] = False
    moved = np.zeros(model.nbody, dtype=bool)
    moved[model.dof_bodyid[free]] = True
    for body in range(1, model.nbody):
        moved[body] |= moved[model.body_parentid[body]]
    return moved


def _actuators(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run]) -> list[Place]:
    control = np.concatenate([run.control for run in runs])
    idle = np.zeros(model.nactuator, dtype=bool)
    if channels.prescribed is not None:
        idle = only_on(model, channels.prescribed)
    places = []
    for i in np.flatnonzero(~idle & (model.actuator_ctrlnum > 0)):
        first = int(model.actuator_ctrladr[i])
        signal: Array = control[:, first]
        if np.ptp(signal) > 0:
            name = actuator_name(model, i)
            most = float(np.abs(signal).max())
            force = _servo_force(model, channels, runs, int(i))
            places.append(Place(f"actuator:{name}", first, control=most, dt=median_step(runs), servo_force=force))
    return places


def _servo_force(model: mujoco.MjModel, channels: Channels, runs: Sequence[Run], actuator: int) -> float:
    """The most that a servo gives along the recordings; 0 of other drives, and of one whose joint is not recorded."""
    servo = ServoLaw.of(model, actuator)
    if servo is None or servo.dof not in channels.dof:
        return 0.0
    c = int(np.flatnonzero(channels.dof == servo.dof)[0])
    along = (servo.force(run.smooth[:-1, c], run.velocity[:-1, c], run.control[:, servo.index]) for run in runs)
    return max(float(np.abs(force).max()) for force in along)
