"""What goes into the simulations: controls behind the effects on them, and forces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.own_filters import OwnFilter
from torch_activegp.diagnosis.inputs.runs import Array, Run
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.actuator import ActuatorEffect
from torch_activegp.physics.rotor import Past


class Controls:
    """The control of every simulation at every time step, after the effects on the way from command to force.

    Args:
        segments: S segments.
        candidates: N candidates.
        substeps: time steps in each interval between rows.
        nu: number of controls.
        filters: of the model's own drives, behind the effects.
    """

    def __init__(
        self,
        segments: Segments,
        candidates: Sequence[Candidate],
        substeps: int,
        nu: int,
        filters: Sequence[OwnFilter] = (),
    ) -> None:
        self._shape = (len(candidates), segments.size, nu)
        plain, dt = _held(segments.runs, substeps, nu)
        chains: dict[tuple[ActuatorEffect, ...], list[int]] = {}
        for i, candidate in enumerate(candidates):
            acting = (effect for effect in candidate.effects if isinstance(effect, ActuatorEffect))
            chains.setdefault(tuple(sorted(acting, key=lambda effect: effect.order)), []).append(i)
        self.held = not any(chains) and not filters
        """Whether no control changes between two rows."""
        sets = [plain[None]]
        self._slot = np.zeros(len(candidates), dtype=np.int64)
        for chain, members in chains.items():
            if not chain:
                continue
            control = np.repeat(plain[None], len(members), axis=0)
            for effect in chain:
                values = np.stack([candidates[i].values[candidates[i].effects.index(effect)] for i in members])
                effect.control(control, dt, values)
            self._slot[members] = np.arange(len(members)) + sum(map(len, sets))
            sets.append(control)
        self._all = np.concatenate(sets)
        self._dt = dt
        for own in filters:
            own.apply(self._all, dt)
        self._first = segments.first * substeps
        self._run = segments.run
        self._substeps = substeps
        shoves = [candidate.shove for candidate in candidates]
        zero = np.zeros((segments.size, segments.intervals, nu))
        self._shoves = None if all(shove is None for shove in shoves) else added(zero, shoves)
        self._known: dict[tuple[int, ...], Array] = {(0,): self._all}

    def states(self, own: OwnFilter) -> Array:
        """What a filter that is left to the simulation begins each segment with, ``(N * S,)``."""
        before = own.states(self._all, self._dt)
        rows = np.minimum(self._first, before.shape[-1] - 1)
        return np.asarray(before[self._slot[:, None], self._run[None], rows[None]].ravel())

    def __call__(self, steps: NDArray[np.int64], together: tuple[int, ...] = (0,)) -> Array:
        """Controls of all simulations in some time steps, ``(N * S, M, nu)``.

        Args:
            steps: M of them, counted from the beginning of each segment; they may lie before it.
            together: the mean of the controls so many steps later is meant.
        """
        table = self._means(together)
        rows = np.minimum(np.maximum(self._first[:, None] + steps, 0), table.shape[2] - 1)
        count, size, nu = self._shape
        if self.held:
            control = np.broadcast_to(table[0, self._run[:, None], rows], (count, size, len(steps), nu))
        else:
            control = table[self._slot[:, None, None], self._run[None, :, None], rows[None]]
        if self._shoves is not None:
            control = control + _mean([self._shoves[:, :, self.interval(steps + later)] for later in together])
        return np.asarray(control.reshape(count * size, len(steps), nu))

    def past(self, which: NDArray[np.integer[Any]]) -> Past:
        """What is known of the time before some of the simulations begin: clocks, and mean controls between rows.

        Controls of candidates alone (:attr:`Candidate.shove`) are of the simulations, not of what was before.
        """
        candidate, segment = np.divmod(which, self._shape[1])

        def control(some: NDArray[Any], rows: int) -> Array:
            slot, part = self._slot[candidate[some], None], segment[some]
            steps = self._first[part, None] + np.arange(-rows * self._substeps, 0)
            at = np.clip(steps, 0, self._all.shape[2] - 1)
            known = self._all[slot, self._run[part, None], at]
            return np.asarray(known.reshape(len(some), rows, self._substeps, -1).mean(axis=2))

        ends = np.cumsum(self._dt, axis=1)[:, self._substeps - 1 :: self._substeps]
        return Past(np.pad(ends, ((0, 0), (1, 0))), self._slot[candidate], control)

    def interval(self, steps: NDArray[np.int64]) -> NDArray[np.int64]:
        """The interval that some time steps lie in, the first one for those before it."""
        return np.asarray(np.maximum(steps // self._substeps, 0))

    def _means(self, together: tuple[int, ...]) -> Array:
        """Means of controls over some steps around each step of whole runs, ``(U, R, T', nu)``; the ends are held."""
        if together not in self._known:
            length = self._all.shape[2]
            steps = np.arange(length + max(0, -min(together)))
            rows = [np.clip(steps + later, 0, length - 1) for later in together]
            self._known[together] = _mean([self._all[:, :, some] for some in rows])
        return self._known[together]


class Inputs:
    """Controls and applied forces of all simulations in each of their time steps.

    Args:
        segments: S segments.
        candidates: N candidates.
        controls: of them.
        substeps: time steps in each interval between rows.
        stride: intervals in each time step, where rows come faster than the motion needs; takes one substep.
        late: whether inputs come half a time step later.
        steady: forces on top that never change, ``(N * S, nv)``, N m or N.
    """

    def __init__(
        self,
        segments: Segments,
        candidates: Sequence[Candidate],
        controls: Controls,
        substeps: int,
        stride: int = 1,
        late: bool = False,
        steady: Array | None = None,
    ) -> None:
        self._control = controls
        force = added(segments.take("force"), [candidate.force for candidate in candidates])
        force = force.reshape(-1, *force.shape[2:])
        self._force = force if force.any() else None
        self._steady = np.zeros_like(force[:, :1]) if steady is None else steady[:, None]
        self.pushes = self._force is not None or bool(self._steady.any())
        """Whether there is any force."""
        self._substeps, self._stride, self._late = substeps, stride, late

    @property
    def held(self) -> bool:
        """Whether no input changes between two rows."""
        return self._control.held and not self._late

    def __call__(self, edges: Sequence[tuple[int, int]]) -> tuple[Array, Array]:
        """Controls and forces of the time steps between some pairs of rows.

        Args:
            edges: M pairs of rows that are as far apart; there is one time step between them where that is more than 1.

        Returns:
            Controls ``(N * S, M * substeps, nu)`` and forces ``(N * S, M * substeps, nv)``, or ``(N * S, 1, nv)`` where
            they never change.
        """
        together = self._together(edges[0][1] - edges[0][0])
        rows = np.array([row for row, _ in edges])
        steps = (rows[:, None] * self._substeps + np.arange(self._substeps)).ravel()
        control = self._control(steps, together)
        if self._force is None:
            return control, self._steady
        force = _mean([self._force[:, self._control.interval(steps + later)] for later in together])
        return control, force + self._steady

    def _together(self, intervals: int) -> tuple[int, ...]:
        """Whose inputs a time step takes, counted in steps from its first; where inputs are late, half before it."""
        if not self._late:
            return tuple(range(intervals))
        if self._stride == 1:
            return (-1, 0)
        half = self._stride // 2, (self._stride + 1) // 2
        return tuple(sorted(k - back for back in half for k in range(intervals)))


def _mean(columns: list[Array]) -> Array:
    return columns[0] if len(columns) == 1 else np.asarray(np.mean(columns, axis=0))


def added(base: Array, more: Sequence[Array | None]) -> Array:
    """A column of every segment ``(S, K, n)`` with what each of N candidates adds, ``(N, S, K, n)``."""
    if all(extra is None for extra in more):
        return np.broadcast_to(base, (len(more), *base.shape))
    return np.stack([base if extra is None else base + extra for extra in more])


def _held(runs: Sequence[Run], substeps: int, nu: int) -> tuple[Array, Array]:
    """Controls of whole runs ``(R, T, nu)`` and the lengths of the time steps ``(R, T)``, the last value held."""
    length = max(len(run) - 1 for run in runs) * substeps
    plain, dt = np.zeros((len(runs), length, nu)), np.zeros((len(runs), length))
    for r, run in enumerate(runs):
        held, steps = np.repeat(run.control, substeps, axis=0), np.repeat(run.dt / substeps, substeps)
        plain[r, : len(held)], plain[r, len(held) :] = held, held[-1:]
        dt[r, : len(steps)], dt[r, len(steps) :] = steps, steps[-1]
    return plain, dt
