"""What sensors read from simulated trajectories."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.simulation.candidate import Candidate, grouped
from torch_activegp.diagnosis.simulation.hermite import position_between
from torch_activegp.physics.effect import Effect


def readings(candidates: Sequence[Candidate], position: Array, velocity: Array, dt: Array) -> Array:
    """What sensors with the candidates' effects read.

    Args:
        candidates: N candidates.
        position: of the recorded joints, ``(N, S, K + 1, C)``, rad or m.
        velocity: same shape, rad/s or m/s.
        dt: length of the intervals, ``(S, K)``, s.

    Returns:
        ``(N, S, K + 1, C)``; ``position`` itself where no effect is a sensor's.
    """
    out = position
    for effect, which, values in grouped(candidates):
        if type(effect).measure is Effect.measure:
            continue
        if out is position:
            out = position.copy()

        def read(channel: int, delay: Array, seen: Array = out, which: NDArray[np.int64] = which) -> Array:
            now, speed = seen[which, :, :, channel], velocity[which, :, :, channel]
            return earlier(now, speed, dt, delay) if delay.any() else now

        result = effect.measure(read, values[:, :, None])
        if result is not None:
            channel, changed = result
            out[which, :, :, channel] = changed
    return out


def earlier(position: Array, velocity: Array, dt: Array, delay: Array) -> Array:
    """Trajectories ``(n, S, K + 1)`` read a delay of n values earlier, s, by cubic Hermite interpolation."""
    time = np.concatenate([np.zeros((len(dt), 1)), np.cumsum(dt, axis=1)], axis=1)
    out = np.empty_like(position)
    for i, late in enumerate(delay.ravel()):
        for s in range(len(dt)):
            wanted = np.maximum(time[s] - late, 0.0)
            k = np.clip(np.searchsorted(time[s], wanted, side="right") - 1, 0, dt.shape[1] - 1)
            h = dt[s, k]
            x = (wanted - time[s, k]) / h
            p, v = position[i, s], velocity[i, s]
            out[i, s] = position_between(x, h, p[k], p[k + 1], v[k], v[k + 1])
    return out
