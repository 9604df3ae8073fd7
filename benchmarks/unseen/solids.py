"""Mass, centre and inertia of simple solids, by hand, as MJCF infers them from geoms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class Solid:
    """A rigid body's mass, centre of mass and inertia about that centre, in the body's frame."""

    mass: float
    com: Array
    inertia: Array

    def __add__(self, other: Solid) -> Solid:
        """Two solids welded together."""
        mass = self.mass + other.mass
        if mass == 0.0:
            return self
        com = (self.mass * self.com + other.mass * other.com) / mass
        return Solid(mass, com, sum((s.about(com) for s in (self, other)), np.zeros((3, 3))))

    def about(self, point: Array) -> Array:
        """Inertia about another point (Steiner)."""
        d = self.com - point
        return self.inertia + self.mass * (d @ d * np.eye(3) - np.outer(d, d))

    def moved(self, shift: Array) -> Solid:
        """The same solid elsewhere."""
        return Solid(self.mass, self.com + shift, self.inertia)


def explicit(mass: float, com: tuple[float, ...], inertia: tuple[float, ...]) -> Solid:
    """As `inertial` says it: three diagonal entries, or also xy, xz, yz."""
    tensor = np.diag(np.asarray(inertia[:3], float))
    if len(inertia) == 6:
        tensor[0, 1] = tensor[1, 0] = inertia[3]
        tensor[0, 2] = tensor[2, 0] = inertia[4]
        tensor[1, 2] = tensor[2, 1] = inertia[5]
    return Solid(mass, np.asarray(com, float), tensor)


def box(mass: float, half: tuple[float, float, float], at: tuple[float, ...] = (0, 0, 0)) -> Solid:
    """A box by half sizes."""
    x, y, z = (4 * h * h for h in half)
    return Solid(mass, np.asarray(at, float), mass / 12 * np.diag([y + z, x + z, x + y]))


def sphere(mass: float, radius: float, at: tuple[float, ...] = (0, 0, 0)) -> Solid:
    """A full ball."""
    return Solid(mass, np.asarray(at, float), 0.4 * mass * radius**2 * np.eye(3))


def cylinder(mass: float, radius: float, half: float, axis: int = 2, at: tuple[float, ...] = (0, 0, 0)) -> Solid:
    """A cylinder along a coordinate axis."""
    across = mass * (radius**2 / 4 + half**2 / 3)
    diagonal = [across] * 3
    diagonal[axis] = mass * radius**2 / 2
    return Solid(mass, np.asarray(at, float), np.diag(diagonal))


def capsule(mass: float, radius: float, start: tuple[float, ...], end: tuple[float, ...]) -> Solid:
    """A capsule between two points: a cylinder and two half balls of one density."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length
    tube = np.pi * radius**2 * length
    balls = 4 / 3 * np.pi * radius**3
    m_tube, m_balls = mass * tube / (tube + balls), mass * balls / (tube + balls)
    along = m_tube * radius**2 / 2 + m_balls * 0.4 * radius**2
    across = m_tube * (radius**2 / 4 + length**2 / 12)
    across += m_balls * (0.4 * radius**2 + length**2 / 4 + 3 / 8 * radius * length)
    return Solid(mass, (a + b) / 2, across * np.eye(3) + (along - across) * np.outer(z, z))


def capsule_mass(density: float, radius: float, length: float) -> float:
    """Mass of a capsule whose straight part has this length."""
    return density * (np.pi * radius**2 * length + 4 / 3 * np.pi * radius**3)


def point(mass: float, at: Array) -> Solid:
    """A point mass."""
    return Solid(mass, np.asarray(at, float), np.zeros((3, 3)))
