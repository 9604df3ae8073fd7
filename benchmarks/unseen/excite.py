"""What the machine is asked to do, and the controllers that make it do so from noisy readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.unseen.machine import Machine
from benchmarks.unseen.plant import Plant
from benchmarks.unseen.simulate import Controller

Array = np.ndarray


def _multisine(t: Array, band: tuple[float, float], rng: np.random.Generator) -> Array:
    f = np.exp(rng.uniform(np.log(band[0]), np.log(band[1]), 8))
    x = (np.sin(2 * np.pi * f * t[:, None] + rng.uniform(0, 2 * np.pi, 8)) / np.sqrt(f)).sum(1)
    return x / np.abs(x).max()


def _chirp(t: Array, band: tuple[float, float], rng: np.random.Generator) -> Array:
    low, high = band if rng.random() < 0.7 else band[::-1]
    T = t[-1]
    k = (high / low) ** (1 / T)
    return np.sin(2 * np.pi * low * (k**t - 1) / np.log(k) + rng.uniform(0, 6)) * rng.uniform(0.6, 1)


def _levels(t: Array, hold: tuple[float, float], pick: Array | None, rng: np.random.Generator) -> Array:
    x, at = np.zeros_like(t), 0.0
    while at < t[-1]:
        x[t >= at] = rng.choice(pick) if pick is not None else rng.uniform(-1, 1)
        at += rng.uniform(*hold)
    return x


def _smooth(t: Array, x: Array, time: float) -> Array:
    y = x.copy()
    for k in range(1, len(t)):
        y[k] = y[k - 1] + (x[k] - y[k - 1]) * min(1.0, (t[k] - t[k - 1]) / time)
    return y


def signal(kind: str, t: Array, band: tuple[float, float], rng: np.random.Generator) -> Array:
    """One channel within [-1, 1]."""
    if "chirp" in kind:
        x = _chirp(t, band, rng)
    elif "steps" in kind:
        x = _levels(t, (0.4, 0.9), None, rng)
    elif kind == "prbs":
        x = _levels(t, (0.12, 0.45), np.array([-1.0, 1.0]), rng) * rng.uniform(0.5, 0.9)
    elif kind == "slow":
        x = np.sin(2 * np.pi * rng.uniform(0.18, 0.35) * t + rng.uniform(0, 6)) * rng.uniform(0.5, 1)
    else:
        x = _multisine(t, band, rng)
    if "track" in kind or kind == "slow":
        x = _smooth(t, _smooth(t, x, 0.12), 0.08)
    return x * np.clip(t / 0.3, 0, 1)


@dataclass
class Plan:
    """Everything random about the recordings of a case: clocks, starts, references, noise."""

    kinds: list[str]
    time: Array
    start: Array
    reference: Array
    feed: Array
    closed: Array
    noise: Array


def plan(machine: Machine, rng: np.random.Generator) -> Plan:
    """As many runs as the machine has, and one more for the test."""
    B, K = machine.runs + 1, round(machine.seconds / machine.dt) + 1
    d, n, m = machine.drive, len(machine.joints), len(machine.motors)
    clock = np.tile(np.arange(K) * machine.dt, (B, 1))
    clock[:, 1:] += machine.jitter * machine.dt * rng.uniform(-1, 1, (B, K - 1))
    clock = np.round(clock, 6)
    kinds = [d.kinds[b % len(d.kinds)] for b in range(B)]
    start = np.asarray(d.pose) + np.asarray(d.spread) * rng.uniform(-1, 1, (B, n))
    joint = [machine.joint(x.joint) for x in machine.motors]
    reference, feed, closed = np.zeros((B, K, m)), np.zeros((B, K, m)), np.zeros(B)
    for b, kind in enumerate(kinds):
        follows = "track" in kind or kind == "slow" or kind == "dither"
        closed[b] = follows
        for a in range(m):
            servo = machine.motors[a].kp > 0
            at = start[b, joint[a]]
            reference[b, :, a] = at
            if follows and kind != "dither":
                reference[b, :, a] += d.travel[a] * signal(kind, clock[b], d.band, rng)
            else:
                x = d.amplitude[a] * signal("multisine" if kind == "dither" else kind, clock[b], d.band, rng)
                feed[b, :, a] = x + (at if servo else 0.0)
    errors = [noise.draw(rng, B, K, machine.dt) for noise in machine.noise]
    return Plan(kinds, clock, start, reference, feed, closed, np.stack(errors, -1))


def hold(machine: Machine, plant: Plant, start: Array) -> Array:
    """Commands that carry the weight at the start."""
    B = len(start)
    if not machine.drive.holds:
        return np.zeros((B, len(machine.motors)))
    zero = np.zeros((B, 0))
    at_rest = np.zeros_like(start)
    _, rhs, _, _ = plant.smooth(np.zeros(B), start, at_rest, zero, np.zeros((B, len(machine.motors))))
    return -rhs[:, plant.joint_of] / (plant.gear * plant.force_gain)


def controller(machine: Machine, p: Plan, readings: Array) -> Controller:
    """Feedback where a run has it; what the encoders show is written to `readings`."""
    d, m = machine.drive, len(machine.motors)
    joint = [machine.joint(x.joint) for x in machine.motors]
    kp, kd = np.asarray(d.kp or (0.0,) * m), np.asarray(d.kd or (0.0,) * m)
    limit = np.array([x.limit for x in machine.motors])
    offset = hold(machine, machine.plant(), p.start)
    speed = np.zeros((len(p.time), m))

    def act(k: int, clean: Array) -> Array:
        seen = clean + p.noise[:, k]
        for j, noise in enumerate(machine.noise):
            seen[:, j] = noise.round(seen[:, j])
        readings[:, k] = seen
        u = offset + p.feed[:, k]
        if kp.any():
            y, wanted = seen[:, joint], p.reference[:, k]
            rate = np.zeros_like(y)
            if k:
                dt = (p.time[:, k] - p.time[:, k - 1])[:, None]
                speed[:] += (1 - np.exp(-dt / 0.02)) * ((y - readings[:, k - 1][:, joint]) / dt - speed)
                rate = (wanted - p.reference[:, k - 1]) / dt
            u = u + p.closed[:, None] * (kp * (wanted - y) + kd * (rate - speed))
        return np.round(np.clip(u, -limit, limit), 6)

    return act
