"""What a machine is on paper: its MJCF file, the same numbers for our own equations, and how it is driven."""

from __future__ import annotations

from dataclasses import dataclass, field
from string import Template

import numpy as np

from benchmarks.unseen.noise import Noise
from benchmarks.unseen.plant import Chain, Friction, Plant
from benchmarks.unseen.solids import Solid
from benchmarks.unseen.tree import Link, Tree

Array = np.ndarray


@dataclass(frozen=True)
class Joint:
    """A joint and the body it carries."""

    name: str
    body: str
    axis: tuple[float, float, float]
    solid: Solid
    parent: str = ""
    hinge: bool = True
    pos: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rot: Array = field(default_factory=lambda: np.eye(3))
    tip: tuple[float, float, float] = (0.0, 0.0, 0.0)
    armature: float = 0.0
    damping: float = 0.0
    frictionloss: float = 0.0
    stiffness: float = 0.0
    springref: float = 0.0
    limits: tuple[float, float] = (-np.inf, np.inf)


@dataclass(frozen=True)
class Motor:
    """Joint force = gear * (gain * u + bias), less a servo's kp and kv; `kp` alone means gain = kp."""

    name: str
    joint: str
    gear: float = 1.0
    gain: float = 1.0
    bias: float = 0.0
    kp: float = 0.0
    kv: float = 0.0
    limit: float = np.inf


@dataclass(frozen=True)
class Drive:
    """How the recordings are made; lists follow the motors, `pose` and `spread` the joints."""

    kinds: tuple[str, ...]
    amplitude: tuple[float, ...]
    band: tuple[float, float]
    pose: tuple[float, ...]
    spread: tuple[float, ...]
    travel: tuple[float, ...] = ()
    kp: tuple[float, ...] = ()
    kd: tuple[float, ...] = ()
    holds: bool = False


@dataclass(frozen=True)
class Machine:
    """A machine; `text` is MJCF with $placeholders for what a lab can tune."""

    name: str
    about: str
    text: str
    joints: tuple[Joint, ...]
    motors: tuple[Motor, ...]
    drive: Drive
    noise: tuple[Noise, ...]
    dt: float
    seconds: float
    runs: int
    step: float = 0.002
    jitter: float = 0.0
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    columns: str = ""
    """A column map (TOML); else the columns are canonical."""
    same: tuple[tuple[tuple[str, str], ...], ...] = ()
    """Groups of effects that no recording of this machine can tell apart."""

    def joint(self, name: str) -> int:
        """Index of a joint."""
        return [j.name for j in self.joints].index(name)

    def motor(self, name: str) -> int:
        """Index of an actuator."""
        return [m.name for m in self.motors].index(name)

    def body(self, name: str) -> int:
        """Index of the joint that carries a body."""
        return [j.body for j in self.joints].index(name)

    def values(self) -> dict[str, float]:
        """What a lab can tune, by placeholder."""
        found: dict[str, float] = {}
        for j in self.joints:
            found |= {f"damping_{j.name}": j.damping, f"armature_{j.name}": j.armature}
        for m in self.motors:
            if m.kp:
                found[f"kp_{m.name}"] = m.kp
            elif f"$gear_{m.name}" in self.text:
                found[f"gear_{m.name}"] = m.gear
            else:
                found[f"gain_{m.name}"] = m.gain
            found[f"bias_{m.name}"] = m.bias
        return {k: v for k, v in found.items() if f"${k}" in self.text}

    def mjcf(self, values: dict[str, float] | None = None) -> str:
        """The file that the user has."""
        words = {k: f"{v:.6g}" for k, v in (values or self.values()).items()}
        return Template(self.text).substitute(words).strip() + "\n"

    def links(self) -> list[Link]:
        """The tree, for our own equations."""
        names = [j.name for j in self.joints]
        return [
            Link(names.index(j.parent) if j.parent else -1, j.hinge, j.axis, j.solid, j.pos, j.rot) for j in self.joints
        ]

    def plant(self, values: dict[str, Array | float] | None = None, links: list[Link] | None = None,
              gravity: Array | None = None) -> Plant:  # fmt: skip
        """Our own model of it; tuned values may be arrays over a batch."""
        tuned = values or {}

        def column(key: str, default: float) -> Array:
            return np.asarray(tuned.get(key, default), float)

        def stack(columns: list[Array]) -> Array:
            return np.stack(np.broadcast_arrays(*columns), -1)

        gears, gains, biases, servos = [], [], [], []
        for m in self.motors:
            kp = column(f"kp_{m.name}", m.kp)
            gears.append(column(f"gear_{m.name}", m.gear))
            gains.append(kp if m.kp else column(f"gain_{m.name}", m.gain))
            biases.append(column(f"bias_{m.name}", m.bias))
            servos.append(kp)
        gear = np.array([m.gear for m in self.motors])
        scale = stack(gears) / gear  # a tuned gear acts on the force alone, as servos keep theirs
        n = len(self.joints)
        return Plant(
            tree=Tree(links or self.links(), np.asarray(self.gravity if gravity is None else gravity)),
            armature=stack([column(f"armature_{j.name}", j.armature) for j in self.joints]),
            damping=stack([column(f"damping_{j.name}", j.damping) for j in self.joints]),
            stiffness=np.array([j.stiffness for j in self.joints]),
            springref=np.array([j.springref for j in self.joints]),
            friction=Friction.of(np.array([j.frictionloss for j in self.joints])),
            joint_of=np.array([self.joint(m.joint) for m in self.motors]),
            gear=gear,
            force_gain=stack(gains) * scale,
            force_bias=stack(biases) * scale,
            servo_p=stack(servos),
            servo_d=np.array([m.kv for m in self.motors]),
            chain=Chain.ideal(len(self.motors)),
            sensor_gain=np.ones(n),
            sensor_bias=np.zeros(n),
            sensor_delay=np.zeros(n),
        )
