"""Process noise: a white acceleration beside the noise of an encoder, and the filter that makes both white.

Second differences of positions tell it in bands: each of them has seen the acceleration of two intervals, and the noise
of three positions. So a filter of two values back whitens them, at any spacing of the rows.

Reference: Bar-Shalom, Li, Kirubarajan, *Estimation with Applications to Tracking and Navigation* (2001), section 6.2.2:
the continuous white noise acceleration model.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments

_RATIOS, _PRECISE = (-10.0, 4.0), 0.02
"""Decimal logarithms of the variance by which an acceleration moves a position in an interval, over the noise of
positions; and how precisely the likeliest is sought."""


@dataclasses.dataclass(frozen=True)
class Differences:
    """First values and second differences of the rows that count, of S segments.

    Args:
        rows: the R rows that they are made of, first those that count, ``(S, R)``.
        known: whether they count, ``(S, R)``.
        weights: of a row and the two before it, ``(3, R, S, 1)``.
        shaken: variance by a white acceleration of unit density, and covariance with the one before, ``(2, R, S, 1)``.
    """

    rows: NDArray[np.int64]
    known: NDArray[np.bool_]
    weights: Array
    shaken: Array

    @classmethod
    def of(cls, segments: Segments) -> Differences:
        """Those of segments, whose simulations begin at their first row without any deviation."""
        used = segments.counts.sum(axis=1)
        rows = np.argsort(~segments.counts, axis=1, kind="stable")[:, : max(int(used.max()), 2)]
        known = np.arange(rows.shape[1]) < used[:, None]
        time = np.concatenate([np.zeros((len(rows), 1)), np.cumsum(segments.dt, axis=1)], axis=1)
        time = np.take_along_axis(time, rows, axis=1).T
        step, begin = np.where(known[:, 1:].T, np.diff(time, axis=0), 1.0), time[0]
        weights, shaken = np.zeros((3, *time.shape)), np.zeros((2, *time.shape))
        weights[0, 0], shaken[0, 0] = 1.0, begin**3 / 3.0
        weights[0, 1], weights[1, 1] = 1.0 / step[0], -1.0 / step[0]
        shaken[0, 1], shaken[1, 1] = begin + step[0] / 3.0, begin**2 / 2.0
        weights[0, 2:], weights[2, 2:] = 1.0 / step[1:], 1.0 / step[:-1]
        weights[1, 2:] = -weights[0, 2:] - weights[2, 2:]
        shaken[0, 2:], shaken[1, 2:] = (step[1:] + step[:-1]) / 3.0, step[:-1] / 6.0
        return cls(rows, known, weights[..., None], shaken[..., None])

    def factor(self, scale: Array, density: Array) -> Array:
        """The Cholesky factor of their covariance, ``(R, 3, S, C)``: of each row its diagonal and what is left of it.

        Args:
            scale: standard deviation of the noise of positions, ``(C,)``, rad or m.
            density: root of the spectral density of the acceleration, ``(C,)``, rad/s2 or m/s2 times the root of s.
        """
        noise, shake, w = scale**2, density**2, self.weights
        own = noise * (w**2).sum(axis=0) + shake * self.shaken[0]
        one, two = shake * self.shaken[1], np.zeros_like(own)
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


class Shaken(NamedTuple):
    """The likeliest process noise of a channel.

    Args:
        scale: standard deviation of the noise of positions, rad or m.
        density: root of the spectral density of the acceleration, rad/s2 or m/s2 times the root of s.
        gain: twice the logarithm of its likelihood over that of white noise alone.
    """

    scale: float
    density: float
    gain: float


def likeliest_process(segments: Segments, series: Array, least: float) -> Shaken:
    """Noise of positions and white acceleration by restricted likelihood, of what a fit leaves.

    What an initial state takes away is about a straight line in each segment.

    Args:
        segments: S segments.
        series: what is left of one channel, ``(S, K + 1)``.
        least: standard deviation of the noise of positions, at least.

    Reference: Harville, *Maximum Likelihood Approaches to Variance Component Estimation and to Related Problems*, J. of
    the American Statistical Association 72 (1977).
    """
    enough = segments.counts.sum(axis=1) > 3
    segments, series = segments.pick(enough), series[enough]
    differences, step = Differences.of(segments), float(np.median(segments.dt))
    time = np.concatenate([np.zeros((len(series), 1)), np.cumsum(segments.dt, axis=1)], axis=1)
    stacked = np.stack([np.ones_like(time), time, np.where(segments.counts, series, 0.0)])[..., None]
    count = int(segments.counts.sum()) - 2 * segments.size

    def misfit(ratio: float) -> tuple[float, float]:
        """Twice the negative logarithm of the likelihood, and the variance of the noise of positions."""
        factor = differences.factor(np.ones(1), np.array([np.sqrt(ratio / step**3)]))
        lines, left = np.split(differences.whiten(stacked, factor)[..., 0], [2])
        basis, small = np.linalg.qr(np.moveaxis(lines, 0, -1))
        left = left[0] - np.einsum("skn,sn->sk", basis, np.einsum("skn,sk->sn", basis, left[0]))
        squares = float((left**2).sum())
        variance = max(squares / count, least**2, 1e-300)
        volume = np.log(factor[:, 0]).sum() + np.log(np.abs(np.diagonal(small, axis1=1, axis2=2))).sum()
        return count * np.log(variance) + squares / variance + 2.0 * float(volume), variance

    still = misfit(0.0)
    told = optimize.minimize_scalar(
        lambda log: misfit(10.0**log)[0], bounds=_RATIOS, method="bounded", options={"xatol": _PRECISE}
    )
    ratio = 10.0**told.x
    return Shaken(np.sqrt(misfit(ratio)[1]), np.sqrt(misfit(ratio)[1] * ratio / step**3), still[0] - float(told.fun))
