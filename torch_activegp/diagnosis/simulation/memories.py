"""What effects remember as simulations begin."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.simulation.controls import Controls
from torch_activegp.physics.effect import Effect, Index
from torch_activegp.physics.rotor import Past

_MOST = 50_000
"""Memories that are kept."""


class Memories:
    """The memory of each effect behind the recordings; those that take long are kept, for each start and parameters.

    Derivatives by every part of the state ask for the same ones again, and so do sets that are fitted side by side: of
    a rotor, at each row of 29 segments, they took half a diagnosis, and a sixth where the last ones alone were kept.

    Args:
        channels: what is recorded.
    """

    def __init__(self, channels: Channels) -> None:
        self._channels = channels
        self._runs: Sequence[Run] = ()
        self._known: dict[Effect, dict[bytes, Array]] = {}

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

        def behind(some: Index) -> Array | None:
            past: tuple[Past, ...] = (controls.past(rows[some]),)
            return effect.memory(positions, starts[some], values[some], *past)

        if not controls.held:
            return behind(np.arange(len(rows)))
        known = self._kept(effect, segments.runs)
        places = [place.tobytes() for place in np.column_stack([starts, values])]
        new = list({place: i for i, place in enumerate(places) if place not in known}.values())
        if new:
            told = behind(np.array(new))
            if told is None:
                return None
            known |= zip((places[i] for i in new), told, strict=True)
        return np.stack([known[place] for place in places])

    def _kept(self, effect: Effect, runs: Sequence[Run]) -> dict[bytes, Array]:
        """What is known of an effect in some runs."""
        if runs is not self._runs or sum(map(len, self._known.values())) > _MOST:
            self._runs, self._known = runs, {}
        return self._known.setdefault(effect, {})


def smoothed(runs: Sequence[Run], channels: Channels, address: int) -> Array | None:
    """Smoothed positions at an address in whole runs, the last one held, ``(R, T)``; None where nothing is recorded."""
    where = np.flatnonzero(channels.qpos == address)
    if not len(where):
        return None
    length = max(len(run) for run in runs)
    return np.stack([np.pad(run.smooth[:, where[0]], (0, length - len(run)), mode="edge") for run in runs])
