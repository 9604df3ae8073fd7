"""What goes into the simulations: controls behind the effects on them, and forces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.candidate import Candidate
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
    """

    def __init__(self, segments: Segments, candidates: Sequence[Candidate], substeps: int, nu: int) -> None:
        self._shape = (len(candidates), segments.size, nu)
        plain, dt = _held(segments.runs, substeps, nu)
        chains: dict[tuple[ActuatorEffect, ...], list[int]] = {}
        for i, candidate in enumerate(candidates):
            acting = (effect for effect in candidate.effects if isinstance(effect, ActuatorEffect))
            chains.setdefault(tuple(sorted(acting, key=lambda effect: effect.order)), []).append(i)
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
        self._first = segments.first * substeps
        self._run = segments.run
        self._substeps = substeps
        shoves = [candidate.shove for candidate in candidates]
        zero = np.zeros((segments.size, segments.intervals, nu))
        self._shoves = None if all(shove is None for shove in shoves) else added(zero, shoves)

    @property
    def held(self) -> bool:
        """Whether no control changes between two rows."""
        return not self._slot.any()

    def __call__(self, interval: int, substep: int) -> Array:
        """Controls of all simulations in a step of an interval, which may be one before the first, ``(N * S, nu)``."""
        rows = np.clip(self._first + interval * self._substeps + substep, 0, self._all.shape[2] - 1)
        count, size, nu = self._shape
        control = self._all[self._slot[:, None], self._run[None], rows[None]]
        if self._shoves is not None:
            control = control + self._shoves[:, :, max(interval, 0)]
        return np.asarray(control.reshape(count * size, nu))


def added(base: Array, more: Sequence[Array | None]) -> Array:
    """A column of every segment ``(S, K, n)`` with what each of N candidates adds, ``(N, S, K, n)``."""
    out = np.broadcast_to(base, (len(more), *base.shape))
    if any(extra is not None for extra in more):
        out = out.copy()
        for i, extra in enumerate(more):
            if extra is not None:
                out[i] += extra
    return out


def _held(runs: Sequence[Run], substeps: int, nu: int) -> tuple[Array, Array]:
    """Controls of whole runs ``(R, T, nu)`` and the lengths of the time steps ``(R, T)``, the last value held."""
    length = max(len(run) - 1 for run in runs) * substeps
    plain, dt = np.zeros((len(runs), length, nu)), np.zeros((len(runs), length))
    for r, run in enumerate(runs):
        held, steps = np.repeat(run.control, substeps, axis=0), np.repeat(run.dt / substeps, substeps)
        plain[r, : len(held)], plain[r, len(held) :] = held, held[-1:]
        dt[r, : len(steps)], dt[r, len(steps) :] = steps, steps[-1]
    return plain, dt
