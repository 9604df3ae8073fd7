"""Excitations: smooth, abrupt and none, different from run to run; all start from zero."""

from __future__ import annotations

import numpy as np

KINDS = ("multisine", "chirp", "steps", "prbs")


def excitation(kind: str, time: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A signal of about unit amplitude (K,) and its rate; the rate is 0 for abrupt ones."""
    fade, fade_rate = np.clip(time / 0.4, 0, 1), np.where(time < 0.4, 1 / 0.4, 0.0)
    if kind == "multisine":
        hertz, phase = rng.uniform(0.2, 2.5, 5), rng.uniform(0, 2 * np.pi, 5)
        size = rng.uniform(0.3, 1, 5) / (0.5 + hertz)
        size /= np.sqrt((size**2).sum())
        angle = 2 * np.pi * hertz * time[:, None] + phase
        signal, rate = np.sin(angle) @ size, np.cos(angle) @ (size * 2 * np.pi * hertz)
    elif kind == "chirp":
        first, last = rng.uniform(0.2, 0.5), rng.uniform(1.5, 4.0)
        slope = (last - first) / time[-1]
        angle = 2 * np.pi * (first * time + slope * time**2 / 2)
        signal, rate = np.sin(angle), np.cos(angle) * 2 * np.pi * (first + slope * time)
    else:
        levels = rng.uniform(-1, 1, 200) if kind == "steps" else rng.choice([-0.8, 0.8], 200)
        spans = rng.uniform(0.3, 1.2, 200) if kind == "steps" else rng.choice([0.15, 0.3, 0.45, 0.6], 200)
        if kind == "prbs":  # what goes forth comes back, so that a free slide stays where it is
            levels, spans = np.resize([0.8, -0.8], 200), np.repeat(spans[:100], 2)
        signal = levels[np.searchsorted(np.cumsum(spans), time, side="right")]
        return signal * (time > 0.1), np.zeros_like(signal)
    return signal * fade, rate * fade + signal * fade_rate
