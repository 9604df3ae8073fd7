"""Advances simulations side by side: in one call where nothing looks at their states on the way, else step by step."""

from __future__ import annotations

import itertools
import logging
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import mujoco
import mujoco.batch
import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.simulation.controls import Inputs
from torch_activegp.physics.effect import Step

_logger = logging.getLogger(__name__)
_EVEN = 1e-9
"""Relative difference between time steps that are the same."""
_FEWER = 4
"""One call for several time steps pays where they come in so many times fewer groups of the same length."""
_BYTES = 16_000_000
_TOGETHER = 16
"""Rows for which inputs are made in one go where time steps are made one by one."""

Act = Callable[[Step], None]
"""What is done before a time step."""
Show = Callable[[Array, Array], None]
"""What changes recorded positions ``(R, nq)`` and velocities ``(R, nv)``."""


class Hooks(NamedTuple):
    """What is done on the way.

    Args:
        acting: before every time step.
        showing: to the states at the end of a step as they are written.
    """

    acting: Sequence[Act] = ()
    showing: Sequence[Show] = ()


class Stepping:
    """The simulations of a batch on their way through the rows of their recordings.

    Args:
        batch: R of its simulations are advanced; their first states are set.
        inputs: their controls and forces.
        field: gives a field of the model with one value for each simulation.
        edges: the E + 1 rows at which time steps begin and end.
        steps: lengths of the time steps between them, ``(R, E)``, s.
        substeps: time steps between two of the rows.
        hooks: what is done on the way.
        middle: see :class:`Step`.
    """

    def __init__(
        self,
        batch: mujoco.batch.Batch,
        inputs: Inputs,
        field: Callable[[str], Array],
        edges: Sequence[int],
        steps: Array,
        substeps: int,
        hooks: Hooks | None = None,
        middle: float = 0.0,
    ) -> None:
        self._batch, self._inputs, self._field = batch, inputs, field
        self._acting, self._showing = hooks or Hooks()
        self._middle = middle
        self._edges, self._steps, self._substeps = list(itertools.pairwise(edges)), steps, substeps
        self._ids = np.arange(len(steps), dtype=np.int32)
        self._time_step = field("opt.timestep")[: len(steps)]
        self._views = {name: batch.bind(name)[: len(steps)] for name in ("qpos", "qvel", "ctrl", "qfrc_applied")}

    def fill(self, states: Array) -> None:
        """Writes the states at the ends of the steps into ``(R, K + 1, nq + nv)``, whose first column is known."""
        groups = list(self._groups())
        if self._acting or len(groups) * _FEWER > len(self._edges):
            self._one_by_one(states)
            return
        for group in groups:
            self._at_once(states, group)

    @property
    def _room(self) -> int:
        """Rows for which there is room for inputs and states."""
        return max(_BYTES // (8 * self._substeps * sum(view.size for view in self._views.values())), 1)

    def _groups(self) -> Iterator[range]:
        """Steps of the same length and as many rows in all simulations, no more together than memory wants."""
        apart = np.diff(self._edges, axis=1)[:, 0]
        change = np.abs(np.diff(self._steps, axis=1)) > _EVEN * self._steps[:, 1:]
        ends = [0, *(np.flatnonzero(change.any(axis=0) | (np.diff(apart) != 0)) + 1), self._steps.shape[1]]
        for first, last in itertools.pairwise(ends):
            for start in range(first, last, self._room):
                yield range(start, min(start + self._room, last))

    def _at_once(self, states: Array, group: range) -> None:
        """Advances through a group of steps in one call."""
        spec = int(mujoco.mjtState.mjSTATE_CTRL)
        self._time_step[:] = self._steps[:, group.start]
        edges = self._edges[group.start : group.stop]
        columns, force = self._inputs(edges)
        if self._inputs.pushes:
            spec |= int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
            shape = (*columns.shape[:2], force.shape[2])
            columns = np.concatenate([columns, np.broadcast_to(force, shape)], axis=2)
        self._views["qfrc_applied"][:] = 0.0
        every = slice(self._substeps - 1, None, self._substeps)
        rows = [after for _, after in edges]
        nq = self._views["qpos"].shape[1]
        out = {
            "qpos": np.full((*columns.shape[:2], nq), np.nan),
            "qvel": np.full((*columns.shape[:2], states.shape[2] - nq), np.nan),
        }
        try:
            self._batch.rollout(columns.shape[1], columns, spec, tuple(out), self._ids, out)
        except mujoco.batch.SimulationError as error:
            _logger.debug("%s", error)
        states[:, rows, :nq], states[:, rows, nq:] = out["qpos"][:, every], out["qvel"][:, every]

    def _one_by_one(self, states: Array) -> None:
        """Advances step by step."""
        position, velocity, control, force = self._views.values()
        at_once = self._inputs.held and not self._acting
        calls, together = (1, self._substeps) if at_once else (self._substeps, 1)
        for k, (after, controls, forces) in enumerate(self._each()):
            self._time_step[:] = self._steps[:, k]
            step = Step(position, velocity, control, force, self._field, self._steps[:, k], self._middle)
            for j in range(calls):
                control[:], force[:] = controls[:, j], forces[:, min(j, forces.shape[1] - 1)]
                for act in self._acting:
                    act(step)
                try:
                    self._batch.step(self._ids, together)
                except mujoco.batch.SimulationError as error:
                    _logger.debug("%s", error)
            shown = states[:, after, : position.shape[1]], states[:, after, position.shape[1] :]
            shown[0][:], shown[1][:] = position, velocity
            for show in self._showing:
                show(*shown)

    def _each(self) -> Iterator[tuple[int, Array, Array]]:
        """The row at each edge's end, and controls and forces up to there, made for several edges together."""
        for _, edges in itertools.groupby(self._edges, key=lambda edge: edge[1] - edge[0]):
            for some in _batched(list(edges), min(_TOGETHER, self._room)):
                controls, forces = self._inputs(some)
                for i, (_, after) in enumerate(some):
                    mine = slice(i * self._substeps, (i + 1) * self._substeps)
                    yield after, controls[:, mine], forces[:, mine] if forces.shape[1] > 1 else forces


def _batched(edges: Sequence[tuple[int, int]], count: int) -> Iterator[Sequence[tuple[int, int]]]:
    """Some edges, no more than a number of them at a time."""
    for first in range(0, len(edges), count):
        yield edges[first : first + count]
