"""What goes into the simulations: controls behind the effects on them, and forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.candidate import Candidate
from torch_activegp.diagnosis.own_filters import OwnFilter
from torch_activegp.diagnosis.runs import Array, Run
from torch_activegp.diagnosis.segments import Segments
from torch_activegp.physics.actuation import ActuatorEffect


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

    def states(self, own: OwnFilter) -> Array:
        """What a filter that is left to the simulation begins each segment with, ``(N * S,)``."""
        before = own.states(self._all, self._dt)
        rows = np.minimum(self._first, before.shape[-1] - 1)
        return np.asarray(before[self._slot[:, None], self._run[None], rows[None]].ravel())

    def __call__(self, interval: int, substep: int) -> Array:
        """Controls of all simulations in a step of an interval, which may be one before the first, ``(N * S, nu)``."""
        rows = self._first + interval * self._substeps + substep
        rows = np.minimum(np.maximum(rows, 0), self._all.shape[2] - 1)
        count, size, nu = self._shape
        if self.held:
            control = np.broadcast_to(self._all[0, self._run, rows], self._shape)
        else:
            control = self._all[self._slot[:, None], self._run[None], rows[None]]
        if self._shoves is not None:
            control = control + self._shoves[:, :, max(interval, 0)]
        return np.asarray(control.reshape(count * size, nu))


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
        self._force = force.reshape(-1, *force.shape[2:]) if force.any() else None
        self._steady = steady if steady is not None and steady.any() else None
        self._substeps, self._stride, self._late = substeps, stride, late

    @property
    def held(self) -> bool:
        """Whether no input changes between two rows."""
        return self._control.held and not self._late

    def __call__(self, row: int, after: int, substep: int) -> tuple[Array, Array | float]:
        """Controls ``(N * S, nu)`` and forces ``(N * S, nv)`` of a time step from one row to another."""
        taken = self._taken(row, after, substep)
        control = _mean([self._control(interval, i) for interval, i in taken])
        if self._force is None:
            return control, 0.0 if self._steady is None else self._steady
        force = _mean([self._force[:, max(k + i // self._substeps, 0)] for k, i in taken])
        return control, force if self._steady is None else force + self._steady

    def _taken(self, row: int, after: int, substep: int) -> list[tuple[int, int]]:
        """Whose inputs a time step takes: intervals, and steps in them; -1 is the one before."""
        if not self._late:
            return [(r, substep) for r in range(row, after)]
        if self._stride == 1:
            return [(row, substep - 1), (row, substep)]
        half = self._stride // 2, (self._stride + 1) // 2
        return [(r - back, 0) for back in half for r in range(row, after)]


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
