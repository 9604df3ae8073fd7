"""Simulates many candidates over many segments side by side through a simulator that only returns its next state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.blackbox import BlackBox
from torch_activegp.diagnosis.inputs.runs import Array, Channels
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.simulation.candidate import Candidate, grouped
from torch_activegp.diagnosis.simulation.controls import Controls, added
from torch_activegp.diagnosis.simulation.engine import Act, Engine, before_steps
from torch_activegp.diagnosis.simulation.force_gp import Remainder
from torch_activegp.diagnosis.simulation.hermite import position_between, velocity_between
from torch_activegp.diagnosis.simulation.memories import smoothed
from torch_activegp.errors import ConfigurationError
from torch_activegp.physics.effect import Index, Step
from torch_activegp.physics.friction import AsymmetricCoulomb, CoulombFriction, StribeckFriction
from torch_activegp.physics.joint import JointEffect

_DRY = (CoulombFriction, StribeckFriction, AsymmetricCoulomb)
_EXACT = 1e-9
_TINY = 1e-100


class BlackBoxEngine(Engine):
    """Runs a black box with effects; the interface is that of `Engine`, forces are accelerations.

    Half of what the laws accelerate in a time step acts before the simulator's step and half after it, which is exact
    to second order. Dry friction takes at most the velocity that is there, so what sticks stays where it is.

    Args:
        box: the simulator.
        channels: the recorded joints.
        substeps: time steps of the simulator in each interval between rows.
        late: whether controls come half a time step later; see `GivenNumerics`.
    """

    def __init__(self, box: BlackBox, channels: Channels, substeps: int, *, late: bool = False) -> None:
        super().__init__(box.model, channels, substeps)
        self.box = box
        self.late = late

    def without_leapfrog(self) -> Engine:
        """The same with its controls when they come."""
        return BlackBoxEngine(self.box, self.channels, self.substeps) if self.late else self

    def _simulate(self, segments: Segments, starts: Array, candidates: Sequence[Candidate]) -> Array:
        count, size, intervals = len(candidates), segments.size, segments.intervals
        rows = count * size
        self.work += rows * intervals * self.substeps
        control = self._controls(segments, candidates)
        force = added(segments.take("force"), [candidate.force for candidate in candidates])
        laws = _Laws(self.channels, segments, candidates)
        states = np.empty((rows, intervals + 1, self.state_size))
        states[:, 0] = now = starts.reshape(rows, -1)
        with np.errstate(all="ignore"):
            for k in range(intervals):
                held = force[:, :, k].reshape(rows, -1)
                for j in range(self.substeps):
                    now = self._advance(now, control[k * self.substeps + j].copy(), held, laws)
                states[:, k + 1] = now
        states[~np.isfinite(states).all(axis=(1, 2))] = np.nan
        table = states.reshape(count, size, intervals + 1, self.state_size)
        return table if _even(segments.dt, self._interval) else _at(table, segments.dt, self._interval)

    def in_longer_steps(self, seconds: float, interval: float) -> BlackBoxEngine:
        """Itself: the simulator steps as it does."""
        return self

    def in_shorter_steps(self, times: int) -> Self:
        """Itself."""
        return self

    @property
    def _interval(self) -> float:
        return self.substeps * self.box.simulator.dt

    def _controls(self, segments: Segments, candidates: Sequence[Candidate]) -> Array:
        """Controls of all simulations in every time step, ``(K * substeps, N * S, nu)``.

        Rows off the simulator's clock: the mean over each of its steps of what was held from row to row.
        """
        control = Controls(segments, candidates, self.substeps, self.model.nu)
        steps = np.arange(segments.intervals * self.substeps)
        table = np.moveaxis(control(steps, (-1, 0) if self.late else (0,)), 1, 0).copy()
        if _even(segments.dt, self._interval):
            return table
        length, step, size = len(table), self.box.simulator.dt, segments.size
        lengths = np.repeat(segments.dt / self.substeps, self.substeps, axis=1)
        held = table.reshape(length, len(candidates), size, -1)
        for s in range(size):
            edges = np.concatenate([[0.0], np.cumsum(lengths[s])])
            clock = np.minimum(step * np.arange(length + 1), edges[-1])
            row = np.clip(np.searchsorted(edges, clock, side="right") - 1, 0, length - 1)
            total = np.concatenate(
                [np.zeros_like(held[:1, :, s]), np.cumsum(held[:, :, s] * _column(lengths[s]), axis=0)]
            )
            until = total[row] + held[row, :, s] * _column(clock - edges[row])
            span = np.diff(clock)
            mean = np.diff(until, axis=0) / _column(np.maximum(span, _EXACT))
            held[:, :, s] = np.where(_column(span) > _EXACT, mean, held[:, :, s])
        return table

    def _advance(self, now: Array, control: Array, held: Array, laws: _Laws) -> Array:
        """One time step of states ``(R, 2 n)`` under controls ``(R, nu)`` and accelerations ``(R, n)``."""
        n, dt = self.model.nq, self.box.simulator.dt
        q, v = now[:, :n], now[:, n:]
        push = laws.begin(q, v, control, held, dt)
        levels = laws.levels(q, v)
        slow = v if levels is None else _braked(v, 0.5 * dt, levels)
        after = self.box.step(np.concatenate([q, slow + 0.5 * dt * push], axis=1), control)
        p, w = after[:, :n], after[:, n:]
        guess = w + 0.5 * dt * push
        levels = laws.levels(p, guess)
        if levels is None:
            return np.concatenate([p, w + 0.5 * dt * laws.end(p, guess, control, push, dt)], axis=1)
        stopped = slow == 0.0  # from there on, friction takes its whole share after the simulator's step
        share = np.where(stopped, dt, 0.5 * dt)
        free = w + 0.5 * dt * laws.end(p, _braked(guess, share, levels), control, push, dt)
        w = _braked(free, share, levels)
        rubbed = stopped & ((levels[0] != 0.0) | (levels[1] != 0.0))
        p = np.where(rubbed, np.where(w == 0.0, q, p + 0.5 * dt * (w - free)), p)
        return np.concatenate([p, w], axis=1)


def _braked(velocity: Array, time: float | Array, levels: tuple[Array, Array]) -> Array:
    """Velocities after dry friction over a time, s, which stops but never reverses them."""
    forward, backward = levels
    onward = np.maximum(velocity - time * forward, 0.0)
    back = np.minimum(velocity + time * backward, 0.0)
    return np.where(velocity > 0.0, onward, np.where(velocity < 0.0, back, velocity))


class _Laws:
    """The effects that accelerate, of all simulations side by side."""

    def __init__(self, channels: Channels, segments: Segments, candidates: Sequence[Candidate]) -> None:
        size = segments.size
        starts = np.stack([segments.run, segments.first], axis=1)
        self._smooth: list[Act] = []
        self._once: list[Act] = []
        self._dry: list[tuple[JointEffect, Index, Array]] = []
        for effect, which, values in grouped(candidates):
            rows = (which[:, None] * size + np.arange(size)).ravel()
            repeated = np.repeat(values, size, axis=0)
            if isinstance(effect, _DRY):
                self._dry.append((effect, rows, repeated))
            elif isinstance(effect, JointEffect) and type(effect).force is not JointEffect.force:
                self._smooth.append(_law(effect, rows, repeated))
            elif effect.needs_steps:
                memory = None
                if isinstance(effect, JointEffect):
                    positions = smoothed(segments.runs, channels, effect.qpos)
                    if positions is not None:
                        memory = effect.memory(positions, np.tile(starts, (len(which), 1)), repeated)
                at_both_ends = isinstance(effect, (JointEffect, Remainder))
                (self._smooth if at_both_ends else self._once).append(before_steps(effect, rows, repeated, memory))

    def begin(self, q: Array, v: Array, control: Array, held: Array, dt: float) -> Array:
        """Accelerations ``(R, n)`` at the start of a step, on top of those that are held over it."""
        self._held = held
        if self._once:
            self._held = self._sum(self._once, q, v, control, held, dt)
        return self._sum(self._smooth, q, v, control, self._held, dt)

    def end(self, q: Array, v: Array, control: Array, push: Array, dt: float) -> Array:
        """The same at its end; those of the start where nothing depends on the state."""
        return self._sum(self._smooth, q, v, control, self._held, dt) if self._smooth else push

    def levels(self, q: Array, v: Array) -> tuple[Array, Array] | None:
        """Dry friction against motions forward and backward, ``(R, n)`` each, or None where there is none."""
        if not self._dry:
            return None
        forward, backward = np.zeros_like(v), np.zeros_like(v)
        for effect, rows, values in self._dry:
            position, speed = q[rows, effect.qpos], np.maximum(np.abs(v[rows, effect.dof]), _TINY)
            forward[rows, effect.dof] -= effect.force(position, speed, values.T)
            backward[rows, effect.dof] += effect.force(position, -speed, values.T)
        return forward, backward

    @staticmethod
    def _sum(acts: Sequence[Act], q: Array, v: Array, control: Array, held: Array, dt: float) -> Array:
        if not acts:
            return held
        step = Step(q, v, control, held.copy(), _no_field, np.full(len(q), dt))
        for act in acts:
            act(step)
        return step.force


def _law(effect: JointEffect, rows: Index, values: Array) -> Act:
    return lambda step: JointEffect.before_step(effect, step, rows, values, None)


def _no_field(name: str) -> Array:
    raise ConfigurationError(f"an effect wants to change `{name}` of a MuJoCo model; the simulator is none.")


def _even(dt: Array, step: float) -> bool:
    """Whether intervals ``(S, K)`` follow a clock, s."""
    return float(np.abs(np.cumsum(dt, axis=1) - step * np.arange(1, dt.shape[1] + 1)).max()) <= _EXACT


def _column(values: Array) -> Array:
    return values[:, None, None]


def _at(states: Array, dt: Array, step: float) -> Array:
    """States ``(N, S, K + 1, 2 n)`` on an even grid, read at the rows' own times by cubic Hermite interpolation."""
    size, intervals = dt.shape
    time = np.concatenate([np.zeros((size, 1)), np.cumsum(dt, axis=1)], axis=1)
    index = np.clip(np.floor(time / step).astype(np.int64), 0, intervals - 1)
    x = (time / step - index)[..., None]
    segment: NDArray[np.int64] = np.arange(size)[:, None]
    begin, end = states[:, segment, index], states[:, segment, index + 1]
    n = states.shape[-1] // 2
    ends = begin[..., :n], end[..., :n], begin[..., n:], end[..., n:]
    return np.concatenate([position_between(x, step, *ends), velocity_between(x, step, *ends)], axis=-1)
