"""Runge-Kutta steps between the samples, with dry friction exact: a joint slides one way, or the other, or sticks.

Every element of a batch has its own step, so that a step ends where a joint comes to rest or a late command arrives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.unseen.plant import Plant

Array = np.ndarray
Controller = Callable[[int, Array], Array]
"""(sample, readings (B, n)) to commands (B, m)."""


def _solve(M: Array, f: Array) -> Array:
    return f / M[:, 0] if f.shape[1] == 1 else np.linalg.solve(M, f[..., None])[..., 0]


@dataclass
class Path:
    """What happened, at the samples: (B, K, .)."""

    time: Array
    q: Array
    v: Array
    reading: Array
    control: Array


class Simulation:
    """A batch of runs of one plant."""

    def __init__(self, plant: Plant, q: Array, v: Array, step: float) -> None:
        self.plant, self.step = plant, step
        self.q, self.v = q.copy(), v.copy()
        self.t = np.zeros(len(q))
        self.rough = plant.friction.any
        self.mode = np.where(self.rough, np.sign(v), 2.0)  # 2: has no dry friction
        self.z = np.zeros((len(q), 0))
        self.lagged = np.zeros((len(q), len(plant.gear)))
        self.log: list[tuple[Array, Array, Array]] = []

    def begin(self, u: Array) -> None:
        """Memories at rest under the first command."""
        u = self.plant.chain.static(u)
        self.lagged = u.copy()
        self.z = np.concatenate(
            [np.zeros((len(u), 0))] + [memory.start(self.q, u) for memory in self.plant.memories], 1
        )

    def _lag(self, target: Array, h: Array) -> Array:
        lag = self.plant.chain.lag
        if not lag.any():
            return target
        fade = np.where(lag > 0, np.exp(-h / np.where(lag > 0, lag, 1.0)), 0.0)
        return target + (self.lagged - target) * fade

    def _acceleration(self, t: Array, q: Array, v: Array, z: Array, u: Array) -> tuple[Array, Array, Array]:
        """Acceleration, rates of the memories, and the force that each sticking joint has to hold."""
        M, rhs, rates, _ = self.plant.smooth(t, q, v, z, u)
        if not self.rough.any():
            return _solve(M, rhs), rates, rhs
        sliding = (self.mode == 1) | (self.mode == -1)
        rhs = rhs - np.where(sliding, self.mode * self.plant.friction.level(self.mode, q, v), 0.0)
        free = (self.mode != 0).astype(float)
        held = M * free[:, :, None] * free[:, None, :]
        n = q.shape[1]
        held[:, range(n), range(n)] += 1 - free
        a = _solve(held, rhs * free)
        return a, rates, rhs - (M @ a[..., None])[..., 0]

    def _release(self, u: Array) -> None:
        """Let go of joints that cannot hold, the most overloaded first."""
        stuck = self.mode == 0
        if not stuck.any():
            return
        zero = np.zeros_like(self.q)
        for _ in range(self.q.shape[1]):
            _, _, load = self._acceleration(self.t, self.q, self.v, self.z, u)
            most = self.plant.friction.level(np.sign(load), self.q, zero)
            over = np.where(self.mode == 0, np.abs(load) - most, -1.0)
            worst = over.argmax(1)
            rows = np.flatnonzero(over[np.arange(len(over)), worst] > 0)
            if not len(rows):
                return
            self.mode[rows, worst[rows]] = np.sign(load[rows, worst[rows]])

    def _rk4(self, h: Array, target: Array) -> tuple[Array, Array, Array]:
        q, v, z, t, hh = self.q, self.v, self.z, self.t, h[:, None]
        u0, u1, u2 = (self._lag(target, s * hh) for s in (0.0, 0.5, 1.0))
        a1, r1, _ = self._acceleration(t, q, v, z, u0)
        v2 = v + hh / 2 * a1
        a2, r2, _ = self._acceleration(t + h / 2, q + hh / 2 * v, v2, z + hh / 2 * r1, u1)
        v3 = v + hh / 2 * a2
        a3, r3, _ = self._acceleration(t + h / 2, q + hh / 2 * v2, v3, z + hh / 2 * r2, u1)
        v4 = v + hh * a3
        a4, r4, _ = self._acceleration(t + h, q + hh * v3, v4, z + hh * r3, u2)
        return (
            q + hh / 6 * (v + 2 * v2 + 2 * v3 + v4),
            v + hh / 6 * (a1 + 2 * a2 + 2 * a3 + a4),
            z + hh / 6 * (r1 + 2 * r2 + 2 * r3 + r4),
        )

    def _substep(self, h: Array, target: Array) -> None:
        """One step, cut short where a sliding joint comes to rest."""
        if not self.rough.any():
            q, v, z = self._rk4(h, target)
        else:
            self._release(self._lag(target, np.zeros((len(h), 1))))
            q, v, z = self._rk4(h, target)
            v_low = self.v
            for attempt in range(7):
                crossed = (np.abs(self.mode) == 1) & (self.mode * v < 0)
                if not crossed.any() or attempt == 6:
                    break
                share = np.where(crossed, v_low / np.where(crossed, v_low - v, 1.0), 1.0)
                fresh = crossed & ((self.mode * self.v <= 1e-9) | (share < 1e-5))  # at rest since the step began
                self.mode = np.where(fresh, 0.0, self.mode)
                self.v = np.where(fresh, 0.0, self.v)
                if fresh.any():
                    self._release(self._lag(target, np.zeros((len(h), 1))))
                h = h * np.where(fresh, 1.0, share).min(1)
                q, v, z = self._rk4(h, target)
            tiny = (np.abs(self.mode) == 1) & (self.mode * self.v > 1e-10) & (self.mode * v < 1e-7)
            crossed = (np.abs(self.mode) == 1) & (self.mode * v < 0)
            stop = tiny | crossed
            self.mode = np.where(stop, 0.0, self.mode)
            v = np.where(stop, 0.0, v)
        self.lagged = self._lag(target, h[:, None])
        at = 0
        for memory in self.plant.memories:
            z[:, at : at + memory.size] = memory.clip(z[:, at : at + memory.size])
            at += memory.size
        self.q, self.v, self.z, self.t = q, v, z, self.t + h

    def advance(self, times: Array, controls: Array, k: int) -> None:
        """From sample k to sample k + 1; times (B, K), controls (B, >k, m)."""
        delay = self.plant.chain.delay
        end = times[:, k + 1]
        while True:
            left = end - self.t
            if (left <= 1e-12).all():
                return
            target, until = controls[:, k], end
            if delay.any():
                target, until = self._late(times, controls, k, end)
            span = np.maximum(until - self.t, 0.0)
            h = span / np.maximum(np.ceil(span / self.step - 1e-9), 1.0)
            self._substep(h, self.plant.chain.static(target))
            if self.plant.sensor_delay.any():
                self.log.append((self.t.copy(), self.q.copy(), self.v.copy()))

    def _late(self, times: Array, controls: Array, k: int, end: Array) -> tuple[Array, Array]:
        """The command that arrives now, and until when it does."""
        target, until = controls[:, k].copy(), end.copy()
        for a in np.flatnonzero(self.plant.chain.delay):
            then = self.t - self.plant.chain.delay[a]
            index = np.maximum((times[:, : k + 1] <= then[:, None] + 1e-10).sum(1) - 1, 0)
            target[:, a] = controls[np.arange(len(index)), index, a]
            after = (times[:, : k + 1] <= then[:, None] + 1e-10).sum(1)
            known = after <= k
            change = times[np.arange(len(index)), np.minimum(after, k)] + self.plant.chain.delay[a]
            until = np.where(known, np.minimum(until, np.maximum(change, self.t + 1e-9)), until)
        return target, until

    def reading(self) -> Array:
        """What perfect sensors of this plant would show now."""
        plant, q = self.plant, self.q.copy()
        for j in np.flatnonzero(plant.sensor_delay):
            then = self.t - plant.sensor_delay[j]
            for b in range(len(q)):
                q[b, j] = self._past(b, int(j), then[b])
        return q * plant.sensor_gain + plant.sensor_bias

    def _past(self, b: int, j: int, then: float) -> float:
        """Position of the past, between logged steps (cubic)."""
        for (t1, q1, v1), (t0, q0, v0) in zip(self.log[::-1], self.log[-2::-1], strict=False):
            if t0[b] <= then:
                if t1[b] <= t0[b]:
                    return float(q0[b, j])
                h, s = t1[b] - t0[b], (then - t0[b]) / (t1[b] - t0[b])
                return float(
                    (1 + 2 * s) * (1 - s) ** 2 * q0[b, j]
                    + s * (1 - s) ** 2 * h * v0[b, j]
                    + s * s * (3 - 2 * s) * q1[b, j]
                    + s * s * (s - 1) * h * v1[b, j]
                )
        return float(self.log[0][1][b, j]) if self.log else float(self.q[b, j])


def simulate(plant: Plant, times: Array, start: tuple[Array, Array], control: Controller, step: float) -> Path:
    """Run it; readings are free of noise here, noise is the controller's own business."""
    q, v = start
    B, K = times.shape
    run = Simulation(plant, q, v, step)
    run.t = times[:, 0].copy()
    run.log.append((run.t.copy(), run.q.copy(), run.v.copy()))
    m = len(plant.gear)
    path = Path(times, np.empty((B, K, plant.tree.n)), np.empty((B, K, plant.tree.n)),
                np.empty((B, K, plant.tree.n)), np.zeros((B, K, m)))  # fmt: skip
    for k in range(K):
        path.q[:, k], path.v[:, k], path.reading[:, k] = run.q, run.v, run.reading()
        path.control[:, k] = control(k, path.reading[:, k])
        if k == 0:
            run.begin(path.control[:, 0])
        if k < K - 1:
            run.advance(times, path.control, k)
    return path
