"""Process noise: a white acceleration beside the noise of an encoder, and the filter that makes both white.

Second differences of positions tell it in bands: each of them has seen the acceleration of two intervals, and the noise
of three positions. So a filter of two values back whitens them, at any spacing of the rows. The acceleration moves a
joint freely: what damping, a spring or a loop make of it in a segment is not in, so that a density beside a spring of
10 Hz came out 1.7 times too large. The errors of rounding are nothing up to some thousand rows in a segment.

Reference: Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 6.2.2:
the continuous white noise acceleration model.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments

_LEAST, _MOST, _PRECISE = 1e-3, 1e4, 0.02
"""Variance, over that of the noise of positions, by which the least acceleration that is sought moves a position in a
segment, and the largest in an interval; and how precisely the decimal logarithm of the likeliest is sought."""
_FEW = 200
"""Fewer values say too little."""


@dataclasses.dataclass(frozen=True)
class Differences:
    """First values and second differences of the rows that count, of S segments.

    Args:
        rows: the R rows that they are made of, first those that count, ``(S, R)``.
        known: whether they count, ``(S, R)``.
        weights: of a row and the two before it, ``(3, R, S, 1)``.
        moved: variance by a white acceleration of unit density, and covariance with the one before, ``(2, R, S, 1)``.
    """

    rows: NDArray[np.int64]
    known: NDArray[np.bool_]
    weights: Array
    moved: Array

    @classmethod
    def of(cls, segments: Segments) -> Differences:
        """Those of segments, whose simulations begin at their first row without any deviation."""
        used = segments.counts.sum(axis=1)
        rows = np.argsort(~segments.counts, axis=1, kind="stable")[:, : max(int(used.max()), 2)]
        known = np.arange(rows.shape[1]) < used[:, None]
        time = np.concatenate([np.zeros((len(rows), 1)), np.cumsum(segments.dt, axis=1)], axis=1)
        time = np.take_along_axis(time, rows, axis=1).T
        step, begin = np.where(known[:, 1:].T, np.diff(time, axis=0), 1.0), time[0]
        weights, moved = np.zeros((3, *time.shape)), np.zeros((2, *time.shape))
        weights[0, 0], moved[0, 0] = 1.0, begin**3 / 3.0
        weights[0, 1], weights[1, 1] = 1.0 / step[0], -1.0 / step[0]
        moved[0, 1], moved[1, 1] = begin + step[0] / 3.0, begin**2 / 2.0
        weights[0, 2:], weights[2, 2:] = 1.0 / step[1:], 1.0 / step[:-1]
        weights[1, 2:] = -weights[0, 2:] - weights[2, 2:]
        moved[0, 2:], moved[1, 2:] = (step[1:] + step[:-1]) / 3.0, step[:-1] / 6.0
        return cls(rows, known, weights[..., None], moved[..., None])

    def factor(self, scale: Array, density: Array) -> Array:
        """The Cholesky factor of their covariance, ``(R, 3, S, C)``: of each row its diagonal and what is left of it.

        Args:
            scale: standard deviation of the noise of positions, ``(C,)``, rad or m.
            density: root of the spectral density of the acceleration, ``(C,)``, rad/s2 or m/s2 times the root of s.
        """
        noise, shake, w = scale**2, density**2, self.weights
        own = noise * (w**2).sum(axis=0) + shake * self.moved[0]
        one, two = shake * self.moved[1], np.zeros_like(own)
        one[1:] += noise * (w[1, 1:] * w[0, :-1] + w[2, 1:] * w[1, :-1])
        two[2:] = noise * w[2, 2:] * w[0, :-2]
        out = np.zeros((len(own), 3, *own.shape[1:]))
        out[:, 0] = 1.0
        for k, known in enumerate(self.known.T[..., None]):
            second = two[k] / out[k - 2, 0]
            first = (one[k] - second * out[k - 1, 1]) / out[k - 1, 0]
            diagonal = np.sqrt(np.maximum(own[k] - first**2 - second**2, 1e-300))
            out[k] = np.where(known, np.stack([diagonal, first, second]), out[k])
        return out

    def whiten(self, values: Array, factor: Array) -> Array:
        """Values ``(..., S, K + 1, C)`` in units of white noise, zero where they do not count."""
        x, w = self._ordered(values), self.weights
        x = w[0] * x + w[1] * _shifted(x, 1) + w[2] * _shifted(x, 2)
        last = before = np.zeros_like(x[..., 0, :, :])
        for k, (own, first, second) in enumerate(factor):
            last, before = (x[..., k, :, :] - first * last - second * before) / own, last
            x[..., k, :, :] = last
        return self._laid(x, values.shape)

    def unwhiten(self, white: Array, factor: Array) -> Array:
        """The transpose of :meth:`whiten`, ``(..., S, K + 1, C)`` both."""
        x, w = self._ordered(white), self.weights
        last = before = np.zeros_like(x[..., 0, :, :])
        for k in reversed(range(len(factor))):
            own, first, second = factor[k]
            solved = (x[..., k, :, :] - last) / own
            x[..., k, :, :], last, before = solved, before + first * solved, second * solved
        x = w[0] * x + _shifted(w[1] * x, -1) + _shifted(w[2] * x, -2)
        return self._laid(x, white.shape)

    def _ordered(self, values: Array) -> Array:
        """Values ``(..., S, K + 1, C)`` at the rows that count, ``(..., R, S, C)``, and zero."""
        picked = np.take_along_axis(values, self._like(self.rows, values.ndim), axis=-2)
        return np.ascontiguousarray(np.swapaxes(np.where(self._like(self.known, values.ndim), picked, 0.0), -3, -2))

    def _laid(self, ordered: Array, shape: tuple[int, ...]) -> Array:
        """The inverse of that, zero where rows do not count."""
        out = np.zeros(shape)
        told = np.where(self._like(self.known, len(shape)), np.swapaxes(ordered, -3, -2), 0.0)
        np.put_along_axis(out, self._like(self.rows, len(shape)), told, axis=-2)
        return out

    @staticmethod
    def _like(each: NDArray[Any], ndim: int) -> NDArray[Any]:
        """What belongs to rows, ``(S, R)``, for values of so many axes, ``(..., S, R, 1)``."""
        return each.reshape(*(1,) * (ndim - 3), *each.shape, 1)


def _shifted(x: Array, by: int) -> Array:
    """Values so many rows later, ``(..., R, S, C)``, zero where there are none."""
    out = np.zeros_like(x)
    to, here = (slice(by, None), slice(None, -by)) if by > 0 else (slice(None, by), slice(-by, None))
    out[..., to, :, :] = x[..., here, :, :]
    return out


def likeliest_density(segments: Segments, series: Array, scale: float) -> tuple[float, float]:
    """Root of the spectral density of a white acceleration beside white noise of positions, by restricted likelihood.

    What an initial state takes away is about a straight line in each segment.

    Args:
        segments: S segments.
        series: what a fit leaves of one channel, ``(S, K + 1)``.
        scale: standard deviation of the noise of positions, rad or m.

    Returns:
        In rad/s2 or m/s2 times the root of s; and twice the logarithm of its likelihood over that of white noise
        alone. Both are 0 where that is the likelier one, or too few values are known.

    Reference: Harville, *Maximum Likelihood Approaches to Variance Component Estimation and to Related Problems*, J. of
    the American Statistical Association 72 (1977).
    """
    enough = segments.counts.sum(axis=1) > 3
    segments, series = segments.pick(enough), np.where(segments.counts, series, 0.0)[enough]
    if segments.counts.sum() < _FEW:
        return 0.0, 0.0
    differences, step = Differences.of(segments), float(np.median(segments.dt))
    time = np.concatenate([np.zeros((len(series), 1)), np.cumsum(segments.dt, axis=1)], axis=1)
    stacked = np.stack([np.ones_like(time), time, series]) * segments.counts

    def misfit(white: Array, volume: float) -> float:
        """Twice the negative logarithm of the likelihood, of whitened lines and series ``(3, S, K + 1)``."""
        basis, small = np.linalg.qr(np.moveaxis(white[:2], 0, -1))
        left = white[2] - np.einsum("skn,sn->sk", basis, np.einsum("skn,sk->sn", basis, white[2]))
        lines = np.log(np.abs(np.diagonal(small, axis1=1, axis2=2))).sum()
        return float((left**2).sum() + 2.0 * (volume + lines))

    def moved(log: float) -> float:
        factor = differences.factor(np.array([scale]), np.array([scale * np.sqrt(10.0**log / step**3)]))
        return misfit(differences.whiten(stacked[..., None], factor)[..., 0], np.log(factor[:, 0]).sum())

    weight = np.log(differences.weights[0, ..., 0])[differences.known.T].sum()
    still = misfit(stacked / scale, segments.counts.sum() * np.log(scale) + weight)
    bounds = np.log10(_LEAST / segments.intervals**3), np.log10(_MOST)
    told = optimize.minimize_scalar(moved, bounds=bounds, method="bounded", options={"xatol": _PRECISE})
    if told.fun >= still:
        return 0.0, 0.0
    return scale * float(np.sqrt(10.0**told.x / step**3)), still - float(told.fun)
