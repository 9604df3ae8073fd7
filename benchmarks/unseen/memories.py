"""Effects that have a state, or that act on what the actuators give."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass
class Plain:
    """No state, no effect."""

    size = 0

    def start(self, q: Array, u: Array) -> Array:
        """At rest."""
        return np.zeros((len(q), self.size))

    def command(self, z: Array, u: Array) -> Array:
        """Unchanged."""
        return u

    def rates(self, z: Array, q: Array, v: Array, u: Array, tau: Array) -> tuple[Array, Array]:
        """None."""
        return np.zeros_like(z), np.zeros_like(q)

    def clip(self, z: Array) -> Array:
        """Unchanged."""
        return z


@dataclass
class Slider(Plain):
    """A spring in series with a dry slider."""

    joint: int
    stiffness: float
    slip: float
    size = 1

    def clip(self, z: Array) -> Array:
        """The slider follows."""
        most = self.slip / self.stiffness
        return np.clip(z, -most, most)

    def rates(self, z: Array, q: Array, v: Array, u: Array, tau: Array) -> tuple[Array, Array]:
        """The spring follows the joint."""
        force = np.zeros_like(q)
        force[:, self.joint] = -self.stiffness * self.clip(z)[:, 0]
        return v[:, self.joint, None], force


@dataclass
class Play(Plain):
    """Motor inertia and joint with a gap between them; the faces are stiff springs with dampers."""

    joint: int
    inertia: float
    gap: float
    stiffness: float
    damping: float
    size = 2

    def start(self, q: Array, u: Array) -> Array:
        """Motor in the middle of the gap."""
        return np.stack([q[:, self.joint], np.zeros(len(q))], 1)

    def rates(self, z: Array, q: Array, v: Array, u: Array, tau: Array) -> tuple[Array, Array]:
        """The actuator moves the motor, the faces move the joint."""
        twist = z[:, 0] - q[:, self.joint]
        deep = np.sign(twist) * np.maximum(np.abs(twist) - self.gap / 2, 0.0)
        face = self.stiffness * deep + np.where(deep != 0, self.damping * (z[:, 1] - v[:, self.joint]), 0.0)
        face = np.where(face * deep > 0, face, 0.0)
        force = np.zeros_like(q)
        force[:, self.joint] = face - tau[:, self.joint]
        return np.stack([z[:, 1], (tau[:, self.joint] - face) / self.inertia], 1), force


@dataclass
class SecondOrder(Plain):
    """A drive that rings."""

    motor: int
    omega: float
    zeta: float
    size = 2

    def start(self, q: Array, u: Array) -> Array:
        """At the first command."""
        return np.stack([u[:, self.motor], np.zeros(len(u))], 1)

    def command(self, z: Array, u: Array) -> Array:
        """What the drive gives."""
        u = u.copy()
        u[:, self.motor] = z[:, 0]
        return u

    def rates(self, z: Array, q: Array, v: Array, u: Array, tau: Array) -> tuple[Array, Array]:
        """A damped oscillator."""
        pull = self.omega**2 * (u[:, self.motor] - z[:, 0]) - 2 * self.zeta * self.omega * z[:, 1]
        return np.stack([z[:, 1], pull], 1), np.zeros_like(q)


@dataclass
class Heat(Plain):
    """A motor that gets weaker as the square of its command heats it."""

    motor: int
    scale: float
    drop: float
    time: float
    size = 1

    def command(self, z: Array, u: Array) -> Array:
        """Weaker."""
        u = u.copy()
        u[:, self.motor] /= 1 + self.drop * z[:, 0]
        return u

    def rates(self, z: Array, q: Array, v: Array, u: Array, tau: Array) -> tuple[Array, Array]:
        """Warms and cools."""
        warm = (u[:, self.motor] / self.scale) ** 2
        return ((warm - z[:, 0]) / self.time)[:, None], np.zeros_like(q)


@dataclass
class Ripple(Plain):
    """A motor whose force per command depends on its angle."""

    joint: int
    depth: float
    waves: float

    def rates(self, z: Array, q: Array, v: Array, u: Array, tau: Array) -> tuple[Array, Array]:
        """More here, less there."""
        force = np.zeros_like(q)
        force[:, self.joint] = self.depth * np.sin(self.waves * q[:, self.joint]) * tau[:, self.joint]
        return np.zeros_like(z), force
