"""Equations of motion of a tree of links, one joint each, for a batch of states: M(q) a + c(q, v) = forces."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from benchmarks.unseen.kernel import compiled
from benchmarks.unseen.solids import Solid

Array = np.ndarray
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
UNIT = np.eye(3)


def cross(a: Array, b: Array) -> Array:
    """Vector product over the last axis (faster than numpy's)."""
    return a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1)


def skew(a: Array) -> Array:
    """Matrices K with K b = a x b."""
    K = np.zeros((*a.shape, 3))
    K[..., 0, 1], K[..., 0, 2], K[..., 1, 2] = -a[..., 2], a[..., 1], -a[..., 0]
    K[..., 1, 0], K[..., 2, 0], K[..., 2, 1] = a[..., 2], -a[..., 1], a[..., 0]
    return K


def turn(axis: Sequence[float], degrees: float) -> Array:
    """A fixed rotation."""
    K = skew(np.asarray(axis, float) / np.linalg.norm(axis))
    a = np.deg2rad(degrees)
    return np.eye(3) + np.sin(a) * K + (1 - np.cos(a)) * K @ K


@dataclass(frozen=True)
class Link:
    """A body and the one joint that carries it (hinge or slide), fixed in its parent at `pos`, turned by `rot`."""

    parent: int
    hinge: bool
    axis: tuple[float, float, float]
    solid: Solid
    pos: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rot: Array = field(default_factory=lambda: np.eye(3))


class Tree:
    """Constants of the links; parents come before their children."""

    def __init__(self, links: Sequence[Link], gravity: Array) -> None:
        self.links = tuple(links)
        self.n = len(links)
        self.gravity = np.asarray(gravity, float)
        unit = [np.asarray(link.axis, float) / np.linalg.norm(link.axis) for link in links]
        self._axis = unit
        self._K = [skew(a) for a in unit]
        self._K2 = [K @ K for K in self._K]
        self._mass = np.array([link.solid.mass for link in links])
        self._com = np.array([link.solid.com for link in links])
        self._inertia = np.array([link.solid.inertia for link in links])
        self._hinge = np.array([link.hinge for link in links])[:, None]
        self._pos = [np.asarray(link.pos, float) for link in links]
        self._plain = [bool(np.array_equal(link.rot, UNIT)) for link in links]
        self._constants = (
            np.array([link.parent for link in links], np.int32),
            np.array([link.hinge for link in links], np.int32),
            *(np.array(x, float) for x in (unit, [link.rot for link in links], self._pos)),
            *(np.array(x, float) for x in (self._mass, self._com, self._inertia, self.gravity)),
        )
        self._pointers = [ctypes.c_void_p(a.ctypes.data) for a in self._constants]
        self._under = np.zeros((self.n, self.n))  # [i, j]: joint j moves body i
        for i, link in enumerate(links):
            if link.parent >= 0:
                self._under[i] = self._under[link.parent]
            self._under[i, i] = 1.0

    def frames(self, q: Array) -> tuple[Array, Array, Array]:
        """Rotations (B, n, 3, 3), centres of mass (B, n, 3) and joint motions (B, n, 6) about the world's origin."""
        B = len(q)
        R = np.empty((B, self.n, 3, 3))
        P, axes = np.empty((B, self.n, 3)), np.empty((B, self.n, 3))
        sin, cos = np.sin(q)[:, :, None, None], 1 - np.cos(q)[:, :, None, None]
        for i, link in enumerate(self.links):
            if link.parent < 0:
                base, pos = np.broadcast_to(link.rot, (B, 3, 3)), np.broadcast_to(self._pos[i], (B, 3))
            else:
                above = R[:, link.parent]
                base = above if self._plain[i] else above @ link.rot
                pos = P[:, link.parent] + above @ self._pos[i]
            axis = base @ self._axis[i]
            axes[:, i] = axis
            if link.hinge:
                R[:, i] = base @ (UNIT + sin[:, i] * self._K[i] + cos[:, i] * self._K2[i])
                P[:, i] = pos
            else:
                R[:, i] = base
                P[:, i] = pos + axis * q[:, i, None]
        S = np.empty((B, self.n, 6))
        S[..., :3] = axes * self._hinge
        S[..., 3:] = np.where(self._hinge, cross(P, axes), axes)
        return R, P + (R @ self._com[..., None])[..., 0], S

    def dynamics(self, q: Array, v: Array) -> tuple[Array, Array]:
        """Mass matrix (B, n, n), without armature, and the force c (B, n) that Coriolis terms and weight ask for."""
        library = compiled()
        if library is None:
            return self.slow_dynamics(q, v)
        M, c = np.empty((*q.shape, self.n)), np.empty(q.shape)
        states = (np.ascontiguousarray(q), np.ascontiguousarray(v), M, c)
        library.dynamics(len(q), self.n, *self._pointers, *[ctypes.c_void_p(a.ctypes.data) for a in states])
        return M, c

    def slow_dynamics(self, q: Array, v: Array) -> tuple[Array, Array]:
        """The same in numpy."""
        R, C, S = self.frames(q)
        m = self._mass[:, None, None]
        K = skew(C)
        spatial = np.empty((*C.shape[:2], 6, 6))
        spatial[..., :3, :3] = R @ self._inertia @ R.swapaxes(-1, -2) - m * (K @ K)
        spatial[..., :3, 3:], spatial[..., 3:, :3] = m * K, -m * K
        spatial[..., 3:, 3:] = m * UNIT
        n = self.n
        whole = (self._under.T @ spatial.reshape(-1, n, 36)).reshape(spatial.shape)
        half = S @ (whole @ S[..., None])[..., 0].swapaxes(-1, -2) * self._under.T  # [j, k], k under j
        M = half + half.swapaxes(-1, -2)
        M[:, range(n), range(n)] *= 0.5

        Sv = S * v[..., None]
        V = self._under @ Sv
        pairs = (*V.shape[:2], 2, 3)
        left = V.reshape(pairs)[:, :, :, None]
        X = cross(left, Sv.reshape(pairs)[:, :, None])  # [angular, linear] times [angular, linear]
        A = self._under @ np.concatenate([X[:, :, 0, 0], X[:, :, 0, 1] + X[:, :, 1, 0]], -1)
        A[..., 3:] -= self.gravity
        h, F = (spatial @ np.stack([V, A], -1)).transpose(3, 0, 1, 2)
        X = cross(left, h.reshape(pairs)[:, :, None])
        F = F + np.concatenate([X[:, :, 0, 0] + X[:, :, 1, 1], X[:, :, 0, 1]], -1)
        return M, (S * (self._under.T @ F)).sum(-1)
