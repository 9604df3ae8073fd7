"""The noise of recorded positions: a level and a colour for each channel, and the filter that makes it white."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.noise.process import Differences

CORRELATED = 0.3
"""Largest correlation of what is new with what was new before: what is more is no filter."""
SEEN = 10.0
"""Twice the logarithm of a likelihood ratio that tells one noise from another."""
_ORDER, _FREQUENCIES = 8, 512


@dataclasses.dataclass(frozen=True)
class NoiseModel:
    """Autoregressive noise, or white noise beside a white acceleration of each joint.

    Args:
        scale: standard deviation of the noise of positions, ``(C,)``, rad or m.
        colour: coefficients of the last two values, ``(C, 2)``; zero for white noise, and beside an acceleration.
        process: root of the spectral density of that, ``(C,)``, rad/s2 or m/s2 times the root of s; None without any.
    """

    scale: Array
    colour: Array
    process: Array | None = None

    @classmethod
    def white(cls, scale: Array) -> NoiseModel:
        """White noise of a standard deviation ``(C,)``."""
        return cls(np.asarray(scale, dtype=float), np.zeros((len(scale), 2)))

    @property
    def innovation(self) -> Array:
        """Standard deviation of what is new in each value, ``(C,)``."""
        first, second = self.colour.T
        ratio = (1 + second) * ((1 - second) ** 2 - first**2) / (1 - second)
        return self.scale * np.sqrt(np.maximum(ratio, 1e-12))

    @property
    def slow(self) -> Array:
        """What is new in slow errors: that of white noise as loud as they are, ``(C,)``."""
        return self.innovation / np.maximum(1.0 - self.colour.sum(axis=1), 1e-6)

    @property
    def of_positions(self) -> NoiseModel:
        """The same without an acceleration."""
        return dataclasses.replace(self, process=None)

    def whiten(self, segments: Segments, residual: Array) -> Array:
        """Residuals in units of white noise, zero where they do not count.

        Args:
            segments: S segments of K intervals.
            residual: ``(..., S, K + 1, C)``, rad or m; linear, so columns of a Jacobian serve too.

        Returns:
            ``(..., S, (K + 1) * C)``.
        """
        white = self._whitened(segments, residual, self.scale, self.colour)
        if self.process is not None:
            differences = Differences.of(segments)
            moved = differences.whiten(residual, differences.factor(self.scale, self.process))
            white = np.where(self.process > 0.0, moved, white)
        return white.reshape(*white.shape[:-2], white.shape[-2] * white.shape[-1])

    def whiten_columns(self, segments: Segments, columns: Array) -> Array:
        """The same for derivatives by A parameters, ``(S, K + 1, C, A)``: ``(S, (K + 1) * C, A)``; NaN becomes zero."""
        *shape, channels, count = columns.shape
        if self.process is not None:
            white = np.moveaxis(self.whiten(segments, np.moveaxis(columns, -1, 0)), 0, -1)
        else:
            scale, colour = np.repeat(self.scale, count), np.repeat(self.colour, count, axis=0)
            each = columns.reshape(*shape, channels * count)
            white = self._whitened(segments, each, scale, colour).reshape(shape[0], shape[1] * channels, count)
        return np.nan_to_num(white, copy=False)

    def _whitened(self, segments: Segments, residual: Array, scale: Array, colour: Array) -> Array:
        """:meth:`whiten` with scale ``(C,)`` and colour ``(C, 2)`` of each channel, and no acceleration."""
        out = residual / scale
        if colour.any():
            first, second = colour.T
            fresh = scale / dataclasses.replace(self, scale=scale, colour=colour).innovation
            inner = out[..., 2:, :] - first * out[..., 1:-1, :] - second * out[..., :-2, :]
            usable = (segments.counts[:, 2:] & segments.counts[:, 1:-1] & segments.counts[:, :-2])[..., None]
            out = np.concatenate([out[..., :2, :], np.where(usable, inner * fresh, out[..., 2:, :])], axis=-2)
        return np.where(segments.counts[..., None], out, 0.0)

    def unwhiten(self, segments: Segments, white: Array) -> Array:
        """The transpose of :meth:`whiten`: from a gradient by whitened residuals to one by residuals.

        Args:
            segments: S segments of K intervals.
            white: ``(S, (K + 1) * C)``.

        Returns:
            ``(S, K + 1, C)``.
        """
        out = np.where(segments.counts[..., None], white.reshape(*segments.counts.shape, -1), 0.0)
        if self.colour.any():
            first, second = self.colour.T
            usable = (segments.counts[:, 2:] & segments.counts[:, 1:-1] & segments.counts[:, :-2])[..., None]
            inner = np.where(usable, out[:, 2:] * self.scale / self.innovation, 0.0)
            out[:, 2:] = np.where(usable, inner, out[:, 2:])
            out[:, 1:-1] -= first * inner
            out[:, :-2] -= second * inner
        out = out / self.scale
        if self.process is not None:
            differences = Differences.of(segments)
            moved = differences.unwhiten(white.reshape(out.shape), differences.factor(self.scale, self.process))
            out = np.where(self.process > 0.0, moved, out)
        return np.asarray(out)


def colour_scale(poles: tuple[float, float]) -> float:
    """Standard deviation of what is new in each value of noise of some colour and unit variance."""
    return float(NoiseModel(np.ones(1), np.array([poles])).innovation[0])


def likeliest(innovation: Callable[[tuple[float, float]], float], count: int) -> tuple[float, float]:
    """The colour of the family with the least variance of what is new; white noise in doubt.

    Args:
        innovation: variance of what is new, by the coefficients of the last two values.
        count: how many values it is the mean of.
    """
    misfit = {poles: count * np.log(innovation(poles)) for poles in colour_family()}
    poles = min(misfit, key=lambda key: misfit[key])
    return poles if misfit[poles] < misfit[0.0, 0.0] - SEEN else (0.0, 0.0)


def is_white(fresh: Sequence[Array], most: float = CORRELATED, lags: int = 3) -> bool:
    """Whether what is new in a value says nothing about the next ones, in series of such values, zero where unknown.

    Args:
        fresh: the series.
        most: correlation, at most.
        lags: how many values later.
    """
    total = sum(float(f @ f) for f in fresh)
    return all(abs(sum(float(f[lag:] @ f[:-lag]) for f in fresh)) <= most * total for lag in range(1, lags + 1))


def high_differences(poles: tuple[float, float]) -> float:
    """Variance that noise of a colour and unit innovations shows to differences of order 8, as `data.noise_std` takes.

    It is one for white noise.
    """
    frequency = (np.arange(_FREQUENCIES) + 0.5) / (2 * _FREQUENCIES)
    weight = np.sin(np.pi * frequency) ** (2 * _ORDER)
    return float((spectrum(poles, frequency) * weight).sum() / weight.sum())


def spectrum(poles: tuple[float, float], frequency: Array) -> Array:
    """That of autoregressive noise with unit innovations, at some parts of the sampling rate."""
    z = np.exp(-2j * np.pi * frequency)
    return np.asarray(1.0 / np.abs(1.0 - poles[0] * z - poles[1] * z**2) ** 2)


def colour_family() -> list[tuple[float, float]]:
    """Colours that filters in encoders give: one pole, and two equal ones."""
    poles = (0.2, 0.4, 0.55, 0.7, 0.8, 0.88, 0.94)
    return [(0.0, 0.0), *((p, 0.0) for p in poles), *((2 * p, -p * p) for p in poles[1:])]
