"""The noise of recorded positions from what a fit leaves, where that is less than was thought."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.noise_model import NoiseModel, colour_family
from torch_activegp.diagnosis.runs import Array
from torch_activegp.diagnosis.shooting import Shooting

_SEEN = 10.0
"""Twice the logarithm of a likelihood ratio that tells a colour, or another level, from the old one."""
_LEAST = 200
"""Fewer values of a channel say too little."""
_FINEST = 3e-5


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
    residual = shooting.segments.position - offset - predicted[0]
    if not np.isfinite(residual[shooting.segments.counts]).all():
        return None
    old = shooting.noise
    scale, colour = old.scale.copy(), old.colour.copy()
    spread = shooting.segments.position[shooting.segments.counts].std(axis=0)
    freed = shooting.dof / max(shooting.samples, 1)
    for channel in range(len(scale)):
        series, usable = residual[..., channel], _usable(shooting.segments.counts)
        if usable.sum() < _LEAST:
            continue
        count, thought = int(usable.sum()), float(old.innovation[channel]) ** 2
        ratio = _innovation(series, usable, tuple(old.colour[channel])) / freed / thought
        worth = {poles: count * np.log(_innovation(series, usable, poles) / freed) for poles in colour_family()}
        poles = min(worth, key=lambda key: worth[key])
        if worth[poles] > worth[0.0, 0.0] - _SEEN:
            poles = (0.0, 0.0)
        if ratio > 1.0 or count * (np.log(thought) + ratio - 1.0) - worth[poles] < _SEEN:
            continue
        level = NoiseModel(np.ones(1), np.array([poles])).innovation[0]
        found = float(np.exp(0.5 * worth[poles] / count) / level)
        scale[channel], colour[channel] = max(found, _FINEST * spread[channel]), poles
    if np.array_equal(scale, old.scale):
        return None
    return NoiseModel(scale, colour)


def _usable(counts: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Where a value and the two before it count, ``(S, K - 1)``."""
    return np.asarray(counts[:, 2:] & counts[:, 1:-1] & counts[:, :-2])


def _innovation(series: Array, usable: NDArray[np.bool_], poles: tuple[float, float]) -> float:
    """Variance of what is new in each value of ``(S, K + 1)``."""
    fresh = series[:, 2:] - poles[0] * series[:, 1:-1] - poles[1] * series[:, :-2]
    return float(np.mean(fresh[usable] ** 2)) + 1e-300
