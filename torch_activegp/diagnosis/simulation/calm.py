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
_CHECKED, _CHECKED_SECONDS = 4, 0.3
"""Segments, and so much of them, in which a candidate is simulated in all of the steps to see that fewer are enough."""
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
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        channels: Channels,
        substeps: int,
        calm: int,
        nthread: int = 0,
        integrator: int | None = None,
    ) -> None:
        super().__init__(model, channels, substeps, nthread, integrator)
        self._calm = Engine(model, channels, calm, nthread, integrator)
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
    """An engine in fewer time steps than it is asked for, where these do the same.

    Not in segments in which something touches, and not with effects that strike, stick or act within a step. Of every
    other candidate a part is simulated in all of the steps too, for a spring or a load may make a machine quick: where
    that is another path, all of it is.

    Args:
        model: compiled nominal model.
        channels: the recorded joints, C.
        substeps: time steps in each interval between rows.
        calm: the same where fewer are enough.
        same: by how much the positions may differ, ``(C,)``, rad or m.
        nthread: threads; 0 for all cores.
        integrator: as for an engine.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        channels: Channels,
        substeps: int,
        calm: int,
        same: Array,
        nthread: int = 0,
        integrator: int | None = None,
    ) -> None:
        super().__init__(model, channels, substeps, calm, nthread, integrator)
        self._same = same

    def steps_in(self, segments: Segments) -> float:
        """Time steps of one simulation of some segments at most: as effects want them that are not smooth."""
        return Engine.steps_in(self, segments)

    def _simulate(self, segments: Segments, starts: Array, candidates: Sequence[Candidate]) -> Array:
        wants = np.array([any(map(self.wants_steps, candidate.effects)) for candidate in candidates])
        states = np.empty((len(candidates), segments.size, segments.intervals + 1, self.state_size))
        if len(calm := np.flatnonzero(~wants)):
            some = [candidates[int(i)] for i in calm]
            states[calm] = super()._simulate(segments, starts[calm], some)
            wants[calm] = ~self._do_the_same(segments, starts[calm], some, states[calm])
        if len(short := np.flatnonzero(wants)):
            states[short] = Engine._simulate(self, segments, starts[short], [candidates[int(i)] for i in short])
        return states

    def _do_the_same(
        self, segments: Segments, starts: Array, candidates: Sequence[Candidate], states: Array
    ) -> NDArray[np.bool_]:
        """Which candidates all of the steps lead the same way, in the beginnings of some segments, ``(N,)``."""
        which = segments.spread(_CHECKED)
        rows = min(max(int(_CHECKED_SECONDS / np.median(segments.dt)), 1), segments.intervals)
        part = segments.pick(which).until(rows)
        exact = Engine._simulate(self, part, starts[:, which], [some.pick(which, rows) for some in candidates])
        off = np.abs(exact - states[:, which, : rows + 1])[..., self.channels.qpos]
        return np.asarray((off < self._same).all(axis=(1, 2, 3)) & np.isfinite(states).all(axis=(1, 2, 3)))

    def wants_steps(self, effect: Effect) -> bool:
        """Whether an effect wants the short steps."""
        return is_abrupt(effect) or effect.name in _WITHIN


def is_abrupt(effect: Effect) -> bool:
    """Whether an effect strikes or sticks, or wants short time steps for another reason."""
    return effect.needs_steps or effect.name in _DRY
