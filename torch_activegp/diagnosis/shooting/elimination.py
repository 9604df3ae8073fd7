"""Normal equations after the free initial states are projected out."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array

UNSEEN = 1e-9
"""What changes chi2 by less is rounding errors."""
SAME_DIRECTION = 1e-6
"""Of the largest eigenvalue about: a direction in which columns differ by less is none."""


@dataclasses.dataclass(frozen=True)
class Eliminated:
    """Normal equations after the initial states were projected out.

    Args:
        normal: ``(S, P, P)``.
        gradient: ``(S, P)``.
        basis: orthonormal basis of the directions of the m states that move anything, ``(S, M, m)``.
        triangle: ``(S, m, n)``.
        columns: the parameters' columns ``(S, M, P)`` before projection.
        residual: ``(S, M)``.
    """

    normal: Array
    gradient: Array
    basis: Array
    triangle: Array
    columns: Array
    residual: Array

    @functools.cached_property
    def promise(self) -> Array:
        """Chi2 that the initial states alone can take away in each segment, to first order, ``(S,)``."""
        return np.asarray((np.einsum("smn,sm->sn", self.basis, self.residual) ** 2).sum(-1))

    def promised(self, shift: Array, delta: Array | None = None) -> Array:
        """Chi2 that a step of the initial states ``(S, n)`` takes away in each segment, to first order, ``(S,)``.

        Args:
            shift: the step.
            delta: change of the parameters beside it, ``(P,)``; what that takes away of what no state could is not in.
        """
        left = np.einsum("smn,sm->sn", self.basis, self.residual)
        moved = np.einsum("sij,sj->si", self.triangle, shift)
        if delta is not None:
            moved = moved + np.einsum("smn,smp,p->sn", self.basis, self.columns, delta)
        return np.asarray((left**2 - (left - moved) ** 2).sum(-1))

    def gain(self, delta: Array, shift: Array) -> float:
        """Chi2 that a step takes away, to first order.

        Args:
            delta: change of the parameters, ``(P,)``.
            shift: of the initial states, ``(S, n)``.
        """
        states = float(self.promised(shift, delta).sum())
        return states + float(2.0 * self.gradient.sum(0) @ delta - delta @ self.normal.sum(0) @ delta)

    def states(self, delta: Array, reach: Array, damping: Array | float = 0.0) -> Array:
        """The change of the initial states that belongs to a change of the parameters, ``(S, n)``.

        Args:
            delta: change of the parameters, ``(P,)``.
            reach: how far a state may sensibly move, ``(n,)``; what hardly shows (the speed of a joint that friction
                holds) moves by no more.
            damping: of each segment, ``(S,)``, in units of the diagonal of the states' normal matrix. Where a joint
                sticks soon, its place and its speed show in the same way, and their difference hardly.
        """
        left = self.residual - self.columns @ delta
        right = np.einsum("smn,sm->sn", self.basis, left)
        normal = self.triangle.transpose(0, 2, 1) @ self.triangle
        size = np.diagonal(normal, axis1=1, axis2=2) * np.broadcast_to(damping, len(normal))[:, None]
        normal = normal + (size + 1.0 / reach**2)[:, :, None] * np.eye(len(reach))
        wanted = np.einsum("sij,si->sj", self.triangle, right)[..., None]
        try:
            return np.linalg.solve(normal, wanted)[..., 0]
        except np.linalg.LinAlgError:
            return np.stack([_solved(*pair) for pair in zip(normal, wanted, strict=True)])[..., 0]


def _solved(normal: Array, wanted: Array) -> Array:
    """The solution of one segment; the shortest where its simulation flies apart and all states show alike."""
    try:
        return np.asarray(np.linalg.solve(normal, wanted), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(normal, hermitian=True) @ wanted)


def scaled(normal: Array) -> tuple[Array, Array]:
    """A normal matrix ``(P, P)`` with ones on its diagonal, and what its columns were divided by, ``(P,)``."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    return normal / np.outer(scale, scale), scale


def invert(normal: Array, rcond: float = 1e-10) -> Array:
    """Inverse of a normal matrix ``(P, P)`` in any units; directions that nothing sees are left out."""
    matrix, scale = scaled(normal)
    return np.asarray(np.linalg.pinv(matrix, rcond=rcond) / np.outer(scale, scale))


def wald(amplitudes: Array, covariance: Array) -> float:
    """What is lost without some amplitudes ``(P,)`` whose covariance is ``(P, P)``: Wald's statistic."""
    if amplitudes.size == 1 and covariance[0, 0] > 0.0:
        return float(amplitudes[0] ** 2 / covariance[0, 0])
    return float(amplitudes @ np.linalg.pinv(covariance) @ amplitudes)


def bounded_step(
    normal: Array, gradient: Array, damping: float, at: Array, low: Array, high: Array, little: Array
) -> Array:
    """The step of Levenberg and Marquardt within bounds: a parameter that would leave its bounds stays there.

    So does one that shows nowhere. The matrix is solved in units of its own diagonal: a stop's stiffness in N/m next to
    its position in m would drown in rounding errors.

    Args:
        normal: ``(P, P)``.
        gradient: ``(P,)``.
        damping: in units of the normal matrix's diagonal.
        at: where the parameters are, ``(P,)``.
        low: their least values, ``(P,)``.
        high: their largest, ``(P,)``.
        little: a small change of each, ``(P,)``.
    """
    free = np.diag(normal) * little**2 > UNSEEN
    delta = np.zeros(len(at))
    for _ in range(3):
        delta = np.zeros(len(at))
        if free.any():
            matrix, scale = scaled(normal[np.ix_(free, free)])
            damped = matrix + damping * np.eye(len(scale))
            delta[free] = np.linalg.lstsq(damped, gradient[free] / scale, rcond=1e-12)[0] / scale
        wanted = at + delta
        stuck = free & (((wanted < low) & (at <= low)) | ((wanted > high) & (at >= high)))
        if not stuck.any():
            break
        free &= ~stuck
    return np.asarray(np.clip(at + delta, low, high) - at)


def eliminate(design: Array, columns: Array, residual: Array) -> Eliminated:
    """Projects the free initial states out of the columns and the residual of every segment.

    Args:
        design: derivatives by the states, ``(S, M, n)``.
        columns: derivatives by the parameters, ``(S, M, P)``.
        residual: ``(S, M)``.
    """
    moving = design.any(axis=(0, 1))
    basis, small = np.linalg.qr(design[..., moving])
    triangle = np.zeros((len(design), small.shape[1], design.shape[-1]))
    triangle[..., moving] = small
    inside = basis.transpose(0, 2, 1) @ columns
    free = columns - basis @ inside
    left = residual - np.einsum("smn,sn->sm", basis, np.einsum("smn,sm->sn", basis, residual))
    normal = free.transpose(0, 2, 1) @ free
    gradient = np.einsum("smp,sm->sp", free, left)
    return Eliminated(normal, gradient, basis, triangle, columns, residual)


def project(states: Array, columns: Array, residual: Array) -> tuple[Array, Array]:
    """Normal equations of the columns after the free states are projected out."""
    basis, _ = np.linalg.qr(states[..., states.any(axis=(0, 1))])
    free = (columns - basis @ (basis.transpose(0, 2, 1) @ columns)).reshape(residual.size, columns.shape[-1])
    left = residual - np.einsum("smn,sn->sm", basis, np.einsum("smn,sm->sn", basis, residual))
    return free.T @ free, free.T @ left.ravel()


def gained_by(normal: Array, gradient: Array) -> tuple[float, Array]:
    """Decrease of chi2 by some columns and their amplitudes; directions that nothing can see give none."""
    matrix, scale = scaled(normal)
    value, vector = np.linalg.eigh(matrix)
    seen = value > SAME_DIRECTION
    projected = vector.T @ (gradient / scale)
    weights = np.where(seen, projected / np.where(seen, value, 1.0), 0.0)
    return float(projected @ weights), (vector @ weights) / scale
