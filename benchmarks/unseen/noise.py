"""Noise of encoders: white, quantised, or wandering (low-pass filtered)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Noise:
    """White of std `white`; then rounding to `step`; or a first-order low pass of the white noise, of the same std."""

    white: float
    step: float = 0.0
    memory: float = 0.0
    """Time constant of the low pass [s]."""

    @property
    def std(self) -> float:
        """Overall."""
        return float(np.hypot(self.white, self.step / np.sqrt(12)))

    @property
    def kind(self) -> str:
        """In a word."""
        return "quantised" if self.step else "filtered" if self.memory else "white"

    def draw(self, rng: np.random.Generator, runs: int, samples: int, dt: float) -> Array:
        """Errors (runs, samples) before any rounding."""
        e = rng.normal(size=(runs, samples))
        if self.memory:
            a = np.exp(-dt / self.memory)
            for k in range(1, samples):
                e[:, k] = a * e[:, k - 1] + np.sqrt(1 - a * a) * e[:, k]
        return self.white * e

    def round(self, reading: Array) -> Array:
        """What the encoder puts out."""
        return np.round(reading / self.step) * self.step if self.step else reading
