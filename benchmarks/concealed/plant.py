"""A machine in numbers: bodies, and one row of parameters for each joint, actuator and sensor."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import mujoco
import numpy as np

from benchmarks.concealed.dynamics import Tree, read_tree


class J(IntEnum):
    """Columns of the joints' table. SI units; all but the rotor are forces on the joint."""

    ROTOR = 0  # armature
    VISCOUS = 1
    VISCOUS_FORTH = 2  # more of it for v > 0
    QUADRATIC = 3
    DRY_FORTH = 4  # Coulomb level for v > 0
    DRY_BACK = 5
    STATIC = 6  # excess over Coulomb at rest
    STRIBECK = 7  # speed at which it has fallen to 1/e
    SPRING = 8
    REST = 9
    CUBIC = 10
    CONSTANT = 11
    COG1 = 12
    COG1_N = 13
    COG1_PHASE = 14
    COG2 = 15
    COG2_N = 16
    COG2_PHASE = 17
    STOP_LOW = 18
    STOP_HIGH = 19
    STOP_SPRING = 20
    STOP_DAMPER = 21
    GAP = 22  # play between rotor and load
    SLIP = 23  # spring with a slider: its level
    SLIP_SPRING = 24
    BUMP = 25  # magnet: A x exp(-x^2), x = (q - at) / width
    BUMP_AT = 26
    BUMP_WIDTH = 27
    HUM = 28  # A sin(2 pi f t + phase)
    HUM_HZ = 29
    HUM_PHASE = 30
    POCKET = 31  # +k (q - at) within the width
    POCKET_AT = 32
    POCKET_WIDTH = 33
    LOADED = 34  # dry friction that grows with the motor's torque
    SWIRL = 35  # A v sin(N q)
    SWIRL_N = 36
    CROSS = 37  # force per position of another joint
    CROSS_WITH = 38
    CREEP = 39  # Maxwell element: stiffness and time constant
    CREEP_TIME = 40
    WALL = 41  # the contact of the nominal model: distance, stiffness, damping, compliance
    WALL_SPRING = 42
    WALL_DAMPER = 43
    WALL_SOFT = 44


class A(IntEnum):
    """Columns of the actuators' table: force = clip(gain x control + b0 + b1 length + b2 speed)."""

    JOINT = 0
    GEAR = 1
    GAIN = 2
    B0 = 3
    B1 = 4
    B2 = 5
    LIMIT = 6
    FACTOR = 7  # on the control
    BIAS = 8
    DELAY = 9
    LAG = 10
    DEAD = 11  # half width
    DRIFT = 12  # of the factor, per second
    RIPPLE = 13  # A sin(N u)
    RIPPLE_N = 14


class S(IntEnum):
    """Columns of the sensors' table."""

    GAIN = 0
    BIAS = 1
    DELAY = 2


class Plant(NamedTuple):
    """Bodies and tables: joint (n, len(J)), actuator (m, len(A)), sensor (n, len(S))."""

    tree: Tree
    joint: np.ndarray
    actuator: np.ndarray
    sensor: np.ndarray


def read_plant(model: mujoco.MjModel) -> Plant:
    """Read what a nominal model says."""
    joint, actuator, sensor = np.zeros((model.nv, len(J))), np.zeros((model.nu, len(A))), np.zeros((model.nv, len(S)))
    for column, values in (
        (J.ROTOR, model.dof_armature),
        (J.VISCOUS, model.dof_damping),
        (J.DRY_FORTH, model.dof_frictionloss),
        (J.DRY_BACK, model.dof_frictionloss),
        (J.SPRING, model.jnt_stiffness),
        (J.REST, model.qpos_spring),
        (J.STRIBECK, 1.0),
        (J.STOP_LOW, -np.inf),
        (J.STOP_HIGH, np.inf),
        (J.BUMP_WIDTH, 1.0),
        (J.CREEP_TIME, 1.0),
        (J.WALL, np.inf),
    ):
        joint[:, column] = values
    for number in range(model.nu):
        gain, bias = model.actuator_gainprm[number, 0], model.actuator_biasprm[number, :3]
        limit = np.inf
        actuator[number] = [
            model.actuator_trnid[number, 0], model.actuator_gear[number, 0], gain, *bias, limit, 1, *[0] * 7,
        ]  # fmt: skip
    sensor[:, S.GAIN] = 1.0
    _read_wall(model, joint)
    return Plant(read_tree(model), joint, actuator, sensor)


def _read_wall(model: mujoco.MjModel, joint: np.ndarray) -> None:
    """The soft contact of one sphere on a slide along x with a plane, as MuJoCo's manual defines it."""
    planes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    if not planes.size:
        return
    (plane,), ball = planes, int(np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)[0])
    time_constant, ratio = model.geom_solref[ball]
    most = model.geom_solimp[ball, 1]
    joint[0, J.WALL] = model.geom_pos[plane, 0] - model.geom_size[ball, 0]
    joint[0, J.WALL_SPRING] = 1 / (most * time_constant * ratio) ** 2
    joint[0, J.WALL_DAMPER] = 2 / (most * time_constant)
    joint[0, J.WALL_SOFT] = model.body_invweight0[model.geom_bodyid[ball], 0]


def copy(plant: Plant) -> Plant:
    """A plant whose arrays can be changed."""
    return Plant(Tree(*(part.copy() for part in plant.tree)), *(part.copy() for part in plant[1:]))
