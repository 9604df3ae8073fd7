"""The noise of recorded positions from what a fit leaves, where that is less than was thought."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.noise_model import SEEN, NoiseModel, colour_scale, likeliest
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.shooting import Shooting

_LESS = 0.9
"""Noise is taken anew where its variance falls to less than this part: floors are known to a few percent."""
_LEAST = 200
"""Fewer values of a channel say too little."""
_FINEST = 3e-5
"""What is new in each value is no less than this part of the motion: rigid bodies are no more exact."""
_CORRELATED = 0.3
"""Largest correlation of what is new with what was new before: what is more is physics, not a filter."""


def quieter(shooting: Shooting, fit: Fit) -> NoiseModel | None:
    """Level and colour of what a fit leaves, for the channels where that is clearly less than the noise model says.

    A floor without a model cannot tell a filter's noise from a fast motion: under a tight loop that moves at 10 Hz,
    recorded at 100 Hz, it was ten times too high in variance, and hid what was weak. What any model leaves bounds the
    noise from above. It is never taken to be louder than before: what is left may be physics.

    Args:
        shooting: the likelihood.
        fit: the best set.

    Returns:
        The noise, or None where no channel is quieter.
    """
    predicted, _ = shooting.engine.predict(shooting.segments, fit.starts[None], [fit.candidate])
    offset = 0.0 if shooting.offset is None else shooting.offset
    residual, counts = shooting.segments.position - offset - predicted[0], shooting.segments.counts
    usable = np.asarray(counts[:, 2:] & counts[:, 1:-1] & counts[:, :-2])
    if usable.sum() < _LEAST or not np.isfinite(residual[counts]).all():
        return None
    old = shooting.noise
    scale, colour = old.scale.copy(), old.colour.copy()
    spread = np.sqrt(np.mean([run.position.var(axis=0) for run in shooting.segments.runs], axis=0))
    freed = shooting.dof / max(shooting.samples, 1)
    found = False
    for channel, thought in enumerate(old.innovation**2):
        least = min(float(thought), (_FINEST * spread[channel]) ** 2)
        channel_left = _Left(residual[..., channel], usable, freed, least)
        poles = likeliest(channel_left.innovation, int(usable.sum()))
        new, before = channel_left.innovation(poles), channel_left.innovation(tuple(old.colour[channel])) / thought
        gained = usable.sum() * (np.log(thought / new) + before - 1.0)
        if before <= 1.0 and new < _LESS * thought and gained > SEEN and channel_left.is_white(poles):
            found = True
            scale[channel], colour[channel] = np.sqrt(new) / colour_scale(poles), poles
    return NoiseModel(scale, colour) if found else None


class _Left:
    """What is left of one channel.

    Args:
        series: ``(S, K + 1)``.
        usable: where a value and the two before it count, ``(S, K - 1)``.
        freed: degrees of freedom over samples.
        least: variance of what is new, at least.
    """

    def __init__(self, series: Array, usable: NDArray[np.bool_], freed: float, least: float) -> None:
        self._series, self._usable, self._freed, self._least = series, usable, freed, least

    def _fresh(self, poles: tuple[float, float]) -> Array:
        """What is new in each value, zero where it is not known, ``(S, K - 1)``."""
        fresh = self._series[:, 2:] - poles[0] * self._series[:, 1:-1] - poles[1] * self._series[:, :-2]
        return np.where(self._usable, fresh, 0.0)

    def innovation(self, poles: tuple[float, float]) -> float:
        """Variance of what is new."""
        return max(float((self._fresh(poles) ** 2).sum() / self._usable.sum()) / self._freed, self._least, 1e-300)

    def is_white(self, poles: tuple[float, float]) -> bool:
        """Whether what is new in a value says nothing about the next ones."""
        fresh = self._fresh(poles)
        total = float((fresh**2).sum())
        return all(abs(float((fresh[:, k:] * fresh[:, :-k]).sum())) <= _CORRELATED * total for k in (1, 2, 3))
