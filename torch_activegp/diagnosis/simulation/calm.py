"""Longer time steps wherever nothing happens within one: on a machine that strikes now and then, or never."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array, Channels, Run
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.touching import touching, widened
from torch_activegp.physics.effect import Effect

_MOST_ROWS = 4000
"""Rows of a run that are looked at, evenly spread."""
_AROUND = 2
"""Rows before and after one in which something touches that count as touched."""
_DRY = frozenset({"coulomb_friction", "asymmetric_friction", "stribeck_friction"})
_WITHIN = frozenset({"joint_stop", "actuator_delay", "actuator_lag"})
"""What strikes, and what changes a control between two rows, which a long step takes the mean of."""


class CalmEngine(Engine):
    """An engine that takes fewer time steps in segments in which the recorded machine touches nothing.

    Not with effects that want short steps themselves: dry friction, and forces that are held within a step.

    Args:
        model: compiled nominal model.
        channels: the recorded joints.
        substeps: time steps in each interval between rows where something touches.
        calm: the same elsewhere.
        nthread: threads; 0 for all cores.
        integrator: as for an engine.
        contacts: whether bodies may touch in the longer steps.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        channels: Channels,
        substeps: int,
        calm: int,
        nthread: int = 0,
        integrator: int | None = None,
        contacts: bool = True,
    ) -> None:
        super().__init__(model, channels, substeps, nthread, integrator)
        self._calm = Engine(model, channels, calm, nthread, integrator, contacts=contacts)
        self._wide = widened(model)
        self._known: dict[int, tuple[Run, NDArray[np.int64]]] = {}

    def _simulate(self, segments: Segments, starts: Array, candidates: Sequence[Candidate]) -> Array:
        touched = self.touched(segments)
        if touched.all() or any(self.wants_steps(effect) for some in candidates for effect in some.effects):
            return super()._simulate(segments, starts, candidates)
        self._calm.filters, self._calm.work = self.filters, 0.0
        size = len(candidates), segments.size, segments.intervals + 1, self.state_size
        out = np.empty(size)
        for simulate, which in ((super()._simulate, touched), (self._calm._simulate, ~touched)):
            if which.any():
                some = [candidate.pick(which) for candidate in candidates]
                out[:, which] = simulate(segments.pick(which), starts[:, which], some)
        self.work += self._calm.work
        return out

    def steps_in(self, segments: Segments) -> float:
        """Time steps of one simulation of some segments by effects that want no short steps themselves."""
        part = float(self.touched(segments).mean())
        return part * super().steps_in(segments) + (1.0 - part) * self._calm.steps_in(segments)

    def wants_steps(self, effect: Effect) -> bool:
        """Whether an effect wants the short steps everywhere."""
        return is_abrupt(effect)

    def touched(self, segments: Segments) -> NDArray[np.bool_]:
        """In which segments something touches, ``(S,)``."""
        out = np.zeros(segments.size, dtype=bool)
        for number, run in enumerate(segments.runs):
            mine = segments.run == number
            if mine.any():
                before, first = self._counted(run), np.minimum(segments.first[mine], len(run) - 1)
                out[mine] = before[np.minimum(first + segments.lengths[mine], len(run) - 1) + 1] > before[first]
        return out

    def _counted(self, run: Run) -> NDArray[np.int64]:
        """The number of rows before each row, and before the end, in which something touches or is about to."""
        if id(run) not in self._known:
            apart = max(len(run) // _MOST_ROWS, 1)
            rows = np.arange(0, len(run), apart)
            near = np.zeros(len(run), dtype=bool)
            for row in rows[touching(self._wide, self.channels, run, rows)]:
                near[max(row - apart - _AROUND, 0) : row + apart + _AROUND + 1] = True
            self._known[id(run)] = run, np.concatenate([[0], np.cumsum(near)])
        return self._known[id(run)][1]


class SmoothEngine(CalmEngine):
    """An engine of a machine that touches nothing and does not stick, in fewer time steps than it is asked for.

    With effects that strike, stick or act within a step it takes all of them; so it does where a long step fails.
    """

    def _simulate(self, segments: Segments, starts: Array, candidates: Sequence[Candidate]) -> Array:
        states = super()._simulate(segments, starts, candidates)
        if np.isfinite(states).all():
            return states
        return Engine._simulate(self, segments, starts, candidates)

    def touched(self, segments: Segments) -> NDArray[np.bool_]:
        """In which segments something touches, ``(S,)``: in none."""
        return np.zeros(segments.size, dtype=bool)

    def wants_steps(self, effect: Effect) -> bool:
        """Whether an effect wants the short steps."""
        return is_abrupt(effect) or effect.name in _WITHIN


def is_abrupt(effect: Effect) -> bool:
    """Whether an effect strikes or sticks, or wants short time steps for another reason."""
    return effect.needs_steps or effect.name in _DRY
