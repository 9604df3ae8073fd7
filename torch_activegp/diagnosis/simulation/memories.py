"""What effects remember as simulations begin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.simulation.controls import Controls
from torch_activegp.physics.effect import Effect, Index
from torch_activegp.physics.rotor import Past


class _Asked(NamedTuple):
    effect: Effect
    runs: Sequence[Run]
    starts: NDArray[Any]
    values: Array

    def is_as(self, other: _Asked) -> bool:
        same = self.effect is other.effect and self.runs is other.runs
        return same and np.array_equal(self.starts, other.starts) and np.array_equal(self.values, other.values)


class Memories:
    """The memory of each effect behind the recordings; the last one that takes long is kept.

    A derivative by every part of the state asks for the same ones again: of a rotor, at each row of 29 segments, they
    took half a diagnosis.

    Args:
        channels: what is recorded.
    """

    def __init__(self, channels: Channels) -> None:
        self._channels = channels
        self._asked: _Asked | None = None
        self._told: Array = np.empty(0)

    def __call__(
        self, effect: Effect, segments: Segments, rows: Index, values: Array, controls: Controls
    ) -> Array | None:
        """The memory of an effect in some simulations; None where it has none, or nothing is recorded of its joint.

        Args:
            effect: that may remember something.
            segments: S segments.
            rows: simulations ``(n,)``, all segments of one candidate after those of another.
            values: of its parameters in these, ``(n, P)``.
            controls: of all simulations.
        """
        if not hasattr(effect, "qpos"):
            return None
        positions = smoothed(segments.runs, self._channels, effect.qpos)
        if positions is None:
            return None
        one = np.stack([segments.run, segments.first], axis=1)
        starts: NDArray[Any] = np.tile(one, (len(rows) // segments.size, 1))
        if not effect.needs_past:
            return effect.memory(positions, starts, values)
        asked = _Asked(effect, segments.runs, starts, values)
        if self._asked is None or not controls.held or not asked.is_as(self._asked):
            past: tuple[Past, ...] = (controls.past(rows),)
            told = effect.memory(positions, starts, values, *past)
            if not controls.held or told is None:
                return told
            self._asked, self._told = asked, told
        return self._told.copy()  # simulations go on in it


def smoothed(runs: Sequence[Run], channels: Channels, address: int) -> Array | None:
    """Smoothed positions at an address in whole runs, the last one held, ``(R, T)``; None where nothing is recorded."""
    where = np.flatnonzero(channels.qpos == address)
    if not len(where):
        return None
    length = max(len(run) for run in runs)
    return np.stack([np.pad(run.smooth[:, where[0]], (0, length - len(run)), mode="edge") for run in runs])
