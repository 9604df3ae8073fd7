"""A machine as it is: the tree, its losses and springs, the chain from command to joint, and what has a memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from benchmarks.unseen.tree import Tree

Array = np.ndarray
Force = Callable[[Array, Array, Array], Array]
"""(time (B,), q, v) to forces (B, n)."""


class Memory(Protocol):
    """Something with a state of its own, beside positions and velocities."""

    size: int

    def start(self, q: Array, u: Array) -> Array:
        """The state at the beginning, (B, size)."""

    def command(self, z: Array, u: Array) -> Array:
        """What becomes of the command (B, m)."""

    def rates(self, z: Array, q: Array, v: Array, u: Array, tau: Array) -> tuple[Array, Array]:
        """The state's rate and forces on the joints; `u` is the command as it came, `tau` the actuators' forces."""

    def clip(self, z: Array) -> Array:
        """The state after a step."""


@dataclass
class Chain:
    """What happens to each command before it becomes a force; arrays over actuators."""

    gain: Array
    bias: Array
    limit: Array
    dead: Array
    delay: Array
    lag: Array

    @classmethod
    def ideal(cls, m: int) -> Chain:
        """Nothing happens."""
        return cls(np.ones(m), np.zeros(m), np.full(m, np.inf), np.zeros(m), np.zeros(m), np.zeros(m))

    def static(self, u: Array) -> Array:
        """Dead zone and saturation."""
        u = np.sign(u) * np.maximum(np.abs(u) - self.dead, 0.0)
        return np.clip(u, -self.limit, self.limit)


@dataclass
class Friction:
    """Dry friction by joint: a level for each direction, a static excess that falls with speed, a pattern over q."""

    plus: Array
    minus: Array
    excess: Array
    speed: Array
    wave: Array
    waves: Array

    @classmethod
    def of(cls, level: Array) -> Friction:
        """Plain Coulomb friction."""
        n = len(level)
        return cls(level.copy(), level.copy(), np.zeros(n), np.ones(n), np.zeros(n), np.ones(n))

    @property
    def any(self) -> Array:
        """Which joints have some."""
        return (self.plus + self.minus + self.excess) > 0

    def level(self, side: Array, q: Array, v: Array) -> Array:
        """How much friction there is at this side (+1, -1) and speed."""
        base = np.where(side > 0, self.plus, self.minus) + self.excess * np.exp(-((v / self.speed) ** 2))
        return base * (1 + self.wave * np.sin(self.waves * q))


@dataclass
class Plant:
    """Everything that moves; arrays over joints may have a leading batch axis."""

    tree: Tree
    armature: Array
    damping: Array
    stiffness: Array
    springref: Array
    friction: Friction
    joint_of: Array
    gear: Array
    force_gain: Array
    force_bias: Array
    servo_p: Array
    servo_d: Array
    chain: Chain
    forces: list[Force] = field(default_factory=list)
    memories: list[Memory] = field(default_factory=list)
    sensor_gain: Array = field(default_factory=lambda: np.ones(1))
    sensor_bias: Array = field(default_factory=lambda: np.zeros(1))
    sensor_delay: Array = field(default_factory=lambda: np.zeros(1))

    def smooth(self, t: Array, q: Array, v: Array, z: Array, u: Array) -> tuple[Array, Array, Array, Array]:
        """Mass matrix, forces but for dry friction, rates of the memories, and weight; `u` has passed the chain."""
        M, c = self.tree.dynamics(q, v)
        n = self.tree.n
        M[:, range(n), range(n)] += self.armature
        parts, at, came = [], 0, u
        for memory in self.memories:
            parts.append(z[:, at : at + memory.size])
            u = memory.command(parts[-1], u)
            at += memory.size
        u = self.chain.gain * u + self.chain.bias
        push = self.force_gain * u + self.force_bias
        push = push - self.servo_p * self.gear * q[:, self.joint_of] - self.servo_d * self.gear * v[:, self.joint_of]
        tau = (self.gear * push) @ np.eye(n)[self.joint_of]
        rates = [z[:, :0]]
        for memory, part in zip(self.memories, parts, strict=True):
            rate, extra = memory.rates(part, q, v, came, tau)
            rates.append(rate)
            tau = tau + extra
        tau = tau - self.damping * v - self.stiffness * (q - self.springref)
        for force in self.forces:
            tau = tau + force(t, q, v)
        return M, tau - c, np.concatenate(rates, 1) if self.memories else z, c
