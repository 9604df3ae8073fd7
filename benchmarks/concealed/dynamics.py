"""Rigid-body dynamics of a tree of hinges and slides: own spatial algebra about the world's origin, no engine.

Reference: R. Featherstone, *Rigid Body Dynamics Algorithms*, 2008, chapters 5 and 6.
"""

from __future__ import annotations

from typing import NamedTuple

import mujoco
import numpy as np
from numba import njit

compiled = njit(cache=True, error_model="numpy")
inlined = njit(cache=True, error_model="numpy", forceinline=True)
"""For what is called in every step: a call counts the references to every array that it is given."""


class Tree(NamedTuple):
    """Bodies with one joint each, parents first; arrays of length n.

    Args:
        parent: index of the parent, -1 for the world.
        place, turn: (n, 3) and (n, 3, 3), the body's frame in its parent's where the joint is at zero.
        axis: (n, 3), of the joint, in the body's frame.
        slide: (n,), whether the joint slides.
        mass, com, inertia: kg, (n, 3) m, and (n, 3, 3) kg m2 about the centre of mass, in the body's frame.
        gravity: (3,), m/s2.
    """

    parent: np.ndarray
    place: np.ndarray
    turn: np.ndarray
    axis: np.ndarray
    slide: np.ndarray
    mass: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    gravity: np.ndarray


class Work(NamedTuple):
    """Room for intermediate results, so that nothing is allocated in a step."""

    frame: np.ndarray
    origin: np.ndarray
    screw: np.ndarray
    twist: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    mass: np.ndarray
    first: np.ndarray
    second: np.ndarray
    pull: np.ndarray
    turns: np.ndarray  # (2, 3, 3)
    vectors: np.ndarray  # (4, 3)
    momentum: np.ndarray


@compiled
def room(n):
    """Room for a tree of n bodies."""
    return Work(
        np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 6)), np.empty((n, 6)), np.empty((n, 6)), np.empty((n, 6)),
        np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3)), np.empty(6), np.empty((2, 3, 3)), np.empty((4, 3)),
        np.empty(6),
    )  # fmt: skip


def read_tree(model: mujoco.MjModel) -> Tree:
    """Take the table of bodies from a compiled model, in which each body has one joint at its own origin."""
    bodies = range(1, model.nbody)
    assert model.njnt == model.nv == model.nbody - 1 and not model.jnt_pos.any()
    return Tree(
        parent=model.body_parentid[1:].astype(np.int64) - 1,
        place=model.body_pos[1:].copy(),
        turn=np.array([_matrix(model.body_quat[body]) for body in bodies]),
        axis=model.jnt_axis.copy(),
        slide=model.jnt_type == mujoco.mjtJoint.mjJNT_SLIDE,
        mass=model.body_mass[1:].copy(),
        com=model.body_ipos[1:].copy(),
        inertia=np.array([_inertia(model, body) for body in bodies]),
        gravity=model.opt.gravity.copy(),
    )


def _matrix(quaternion: np.ndarray) -> np.ndarray:
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _inertia(model: mujoco.MjModel, body: int) -> np.ndarray:
    principal = _matrix(model.body_iquat[body])
    return principal @ np.diag(model.body_inertia[body]) @ principal.T


@inlined
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inlined
def _spin(axis, angle, out):
    """Rotation matrix about a unit axis."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    k = 1 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k


@inlined
def _times(a, b, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@inlined
def _turned(a, b):
    return (
        a[0, 0] * b[0] + a[0, 1] * b[1] + a[0, 2] * b[2],
        a[1, 0] * b[0] + a[1, 1] * b[1] + a[1, 2] * b[2],
        a[2, 0] * b[0] + a[2, 1] * b[1] + a[2, 2] * b[2],
    )


@inlined
def _copy(a, out):
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, j]


@inlined
def _place(tree, q, work):
    """Frames and joint screws (angular, then linear at the world's origin) in world coordinates."""
    frame, origin, screw = work.frame, work.origin, work.screw
    local, spun = work.turns[0], work.turns[1]
    for i in range(q.size):
        parent = tree.parent[i]
        if parent < 0:
            _copy(tree.turn[i], local)
            for k in range(3):
                origin[i, k] = tree.place[i, k]
        else:
            _times(frame[parent], tree.turn[i], local)
            x, y, z = _turned(frame[parent], tree.place[i])
            origin[i, 0], origin[i, 1], origin[i, 2] = (
                origin[parent, 0] + x,
                origin[parent, 1] + y,
                origin[parent, 2] + z,
            )
        x, y, z = _turned(local, tree.axis[i])
        for k in range(6):
            screw[i, k] = 0.0
        if tree.slide[i]:
            _copy(local, frame[i])
            screw[i, 3], screw[i, 4], screw[i, 5] = x, y, z
            for k in range(3):
                origin[i, k] += q[i] * screw[i, 3 + k]
        else:
            _spin(tree.axis[i], q[i], spun)
            _times(local, spun, frame[i])
            screw[i, 0], screw[i, 1], screw[i, 2] = x, y, z
            _cross(origin[i], screw[i, :3], screw[i, 3:])


@inlined
def _spatial_inertia(tree, i, work):
    """First moment (3,) and second moment about the world's origin (3, 3) of a body."""
    frame, origin, first, second = work.frame[i], work.origin[i], work.first[i], work.second[i]
    x, y, z = _turned(frame, tree.com[i])
    c, half, m = work.vectors[3], work.turns[0], tree.mass[i]
    c[0], c[1], c[2] = origin[0] + x, origin[1] + y, origin[2] + z
    _times(frame, tree.inertia[i], half)
    square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    for a in range(3):
        first[a] = m * c[a]
        for b in range(3):
            turned = half[a, 0] * frame[b, 0] + half[a, 1] * frame[b, 1] + half[a, 2] * frame[b, 2]
            second[a, b] = turned + m * ((square if a == b else 0.0) - c[a] * c[b])


@inlined
def _momentum(m, first, second, twist, work, out):
    """Spatial inertia times a twist: moment about the origin, then force."""
    x, y, z = _turned(second, twist[:3])
    hv, wh = work.vectors[0], work.vectors[1]
    _cross(first, twist[3:], hv)
    _cross(twist[:3], first, wh)
    out[0], out[1], out[2] = x + hv[0], y + hv[1], z + hv[2]
    for k in range(3):
        out[3 + k] = m * twist[3 + k] + wh[k]


@inlined
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


@inlined
def _motion(tree, v, work):
    """Velocity and velocity-product acceleration of each body; the world accelerates against gravity."""
    screw, twist, rate = work.screw, work.twist, work.rate
    one, two, three = work.vectors[0], work.vectors[1], work.vectors[2]
    for i in range(v.size):
        parent = tree.parent[i]
        for k in range(6):
            base = 0.0 if k < 3 else -tree.gravity[k - 3]
            twist[i, k] = (0.0 if parent < 0 else twist[parent, k]) + screw[i, k] * v[i]
            rate[i, k] = base if parent < 0 else rate[parent, k]
        _cross(twist[i, :3], screw[i, :3], one)
        _cross(twist[i, :3], screw[i, 3:], two)
        _cross(twist[i, 3:], screw[i, :3], three)
        for k in range(3):
            rate[i, k] += one[k] * v[i]
            rate[i, 3 + k] += (two[k] + three[k]) * v[i]


@inlined
def _body_force(m, i, work):
    """Force that moves a body as its `rate` says: I a + v x* I v."""
    twist, out, momentum, one, two = work.twist[i], work.force[i], work.momentum, work.vectors[0], work.vectors[1]
    _momentum(m, work.first[i], work.second[i], work.rate[i], work, out)
    _momentum(m, work.first[i], work.second[i], twist, work, momentum)
    _cross(twist[:3], momentum[:3], one)
    _cross(twist[3:], momentum[3:], two)
    for k in range(3):
        out[k] += one[k] + two[k]
    _cross(twist[:3], momentum[3:], one)
    for k in range(3):
        out[3 + k] += one[k]


@compiled
def mass_and_bias(tree, q, v, work, M, bias):
    """Fill the mass matrix (n, n) without rotors, and the force (n,) that gravity and speed ask for."""
    n = q.size
    screw, mass, first, second, force, pull = work.screw, work.mass, work.first, work.second, work.force, work.pull
    for i in range(n):
        mass[i] = tree.mass[i]
        for k in range(n):
            M[i, k] = 0.0
    _place(tree, q, work)
    _motion(tree, v, work)
    for i in range(n):
        _spatial_inertia(tree, i, work)
        _body_force(mass[i], i, work)
    for i in range(n - 1, -1, -1):
        bias[i] = _dot(screw[i], force[i])
        _momentum(mass[i], first[i], second[i], screw[i], work, pull)
        k = i
        while k >= 0:
            M[i, k] = M[k, i] = _dot(screw[k], pull)
            k = tree.parent[k]
        if tree.parent[i] >= 0:
            _add_to(tree.parent[i], i, work)


@inlined
def _add_to(parent, i, work):
    """Let a parent carry a body: composite inertia and force."""
    work.mass[parent] += work.mass[i]
    for k in range(3):
        work.first[parent, k] += work.first[i, k]
        for m in range(3):
            work.second[parent, k, m] += work.second[i, k, m]
    for k in range(6):
        work.force[parent, k] += work.force[i, k]


@inlined
def invert(M):
    """Put the inverse of a positive definite matrix in its place: Gauss and Jordan, no pivoting needed."""
    n = M.shape[0]
    for k in range(n):
        pivot = 1 / M[k, k]
        M[k, k] = 1.0
        for j in range(n):
            M[k, j] *= pivot
        for i in range(n):
            if i != k:
                factor = M[i, k]
                M[i, k] = 0.0
                for j in range(n):
                    M[i, j] -= factor * M[k, j]
