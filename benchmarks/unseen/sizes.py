"""How large an effect is, against what the machine does anyway."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from benchmarks.unseen.effects import Effect
from benchmarks.unseen.machine import Machine
from benchmarks.unseen.plant import Plant
from benchmarks.unseen.simulate import Path

Array = np.ndarray


@dataclass
class Scales:
    """Typical force, speed and travel of each joint, inertia, and command of each motor, in the nominal recordings."""

    force: Array
    speed: Array
    travel: Array
    inertia: Array
    command: Array
    path: Path

    @classmethod
    def of(cls, plant: Plant, path: Path) -> Scales:
        """From a nominal run."""
        q, v = path.q.reshape(-1, plant.tree.n), path.v.reshape(-1, plant.tree.n)
        a = np.gradient(path.v, axis=1) / np.gradient(path.time, axis=1)[..., None]
        M, _ = plant.tree.dynamics(q[:: len(q) // 200 + 1], v[:: len(q) // 200 + 1])
        inertia = np.diagonal(M, axis1=1, axis2=2).mean(0) + plant.armature
        force = (inertia * a.reshape(v.shape) + plant.damping * v).std(0)
        u = path.control.reshape(len(q), -1)
        return cls(force, v.std(0), q.std(0), inertia, u.std(0), path)


def draw(machine: Machine, name: str, target: str, s: Scales, rng: np.random.Generator) -> Effect:
    """An effect of a typical, plainly visible size."""
    r = float(np.exp(rng.uniform(np.log(0.08), np.log(0.25))))
    kind, _, where = target.partition(":")
    j = a = 0
    if kind == "actuator":
        a = machine.motor(where)
        j = machine.joint(machine.motors[a].joint)
    elif kind == "body":
        j = machine.body(where)
    elif kind in ("joint", "sensor"):
        j = machine.joint(where)
    F, V, Q, U = s.force[j], s.speed[j], s.travel[j], s.command[a]
    q = s.path.q[..., j]
    sign = float(rng.choice([-1.0, 1.0]))
    period = 0.25 * Q / V * 2 * np.pi  # about a quarter of the time of one swing
    body, tip = machine.joints[j].solid, np.asarray(machine.joints[j].tip)
    reach = float(np.linalg.norm(tip)) or 0.05
    side = float(rng.choice([-1.0, 1.0]))
    waves = float(np.round(2 * np.pi * rng.uniform(1.5, 3) / (np.ptp(q) if np.ptp(q) < 6 else 4)))
    direction = np.array([0.0, 0.0, 1.0]) if rng.random() < 0.5 or machine.name != "trolley" else np.array([1.0, 0, 0])
    across = rng.normal(size=3) * np.array([1, 0.3, 1])
    across = reach * 0.8 * across / np.linalg.norm(across)
    effects: dict[str, dict[str, float]] = {
        "viscous_friction": {"coefficient": 1.5 * r * F / V},
        "quadratic_drag": {"coefficient": 1.5 * r * F / V**2},
        "coulomb_friction": {"level": r * F},
        "asymmetric_friction": {"level_plus": r * F * (1 + 0.6 * side), "level_minus": r * F * (1 - 0.6 * side)},
        "stribeck_friction": {"coulomb": 1.2 * r * F, "static": 2.6 * r * F, "velocity": 0.3 * V},
        "linear_spring": {"stiffness": 1.5 * r * F / Q, "rest": float(q.mean()) + 0.3 * sign * Q},
        "cubic_spring": {"stiffness": 1.5 * r * F / float(np.mean(q**6)) ** 0.5},
        "constant_force": {"force": sign * r * F},
        "cogging": {"amplitude": r * F, "waves": waves, "phase": rng.uniform(-3, 3)},
        "joint_stop": {"position": float(np.quantile(side * q, 0.93)) * side, "side": side,
                       "stiffness": 6 * F / Q, "damping": 0.4 * F / V},
        "armature_error": {"armature": 1.5 * r * s.inertia[j]},
        "hysteresis": {"stiffness": 1.5 * r * F / (0.35 * Q), "slip": 1.5 * r * F},
        "backlash": {"gap": 0.4 * r * Q, "stiffness": 150.0**2 * machine.joints[j].armature,
                     "damping": 0.6 * 150 * machine.joints[j].armature},
        "payload_mass": {"mass": 2 * r * body.mass} | dict(zip("xyz", map(float, tip), strict=True)),
        "center_of_mass_offset": dict(zip("xyz", map(float, r * across), strict=True)),
        "gravity_error": dict(zip("xyz", map(float, sign * 0.3 * r * 9.81 * direction), strict=True)),
        "actuator_gain": {"gain": 1 + sign * r},
        "actuator_bias": {"bias": sign * r * U},
        "actuator_delay": {"seconds": r * period},
        "actuator_lag": {"time_constant": r * period},
        "actuator_saturation": {"limit": float(np.quantile(np.abs(s.path.control[..., a]), 0.93)) * (1 - r / 2)},
        "actuator_dead_zone": {"width": r * U},
        "sensor_bias": {"bias": sign * r * Q},
        "sensor_gain": {"gain": 1 + sign * r / 2},
        "sensor_delay": {"seconds": r * period},
        "friction_pattern": {"level": 0.35 * F, "depth": 0.9, "waves": waves},
        "periodic_disturbance": {"amplitude": 0.5 * F, "hertz": rng.uniform(1.3, 3.4), "phase": rng.uniform(0, 6)},
        "coupling_spring": {"stiffness": 0.6 * F / Q, "ratio": 0.8, "rest": float(rng.normal() * 0.2 * Q)},
        "second_order_drive": {"omega": 1.6 * V / Q, "zeta": rng.uniform(0.15, 0.3)},
        "thermal_gain": {"scale": U * 1.2 + abs(float(s.path.control[..., a].mean())), "drop": 0.55,
                         "seconds": rng.uniform(1.5, 2.5)},
        "torque_ripple": {"depth": 0.5, "waves": waves},
    }  # fmt: skip
    return Effect(name, target, {k: float(f"{v:.5g}") for k, v in effects[name].items()})


GROWS: dict[str, tuple[str, ...]] = {
    "viscous_friction": ("coefficient",), "quadratic_drag": ("coefficient",), "coulomb_friction": ("level",),
    "asymmetric_friction": ("level_plus", "level_minus"), "stribeck_friction": ("coulomb", "static"),
    "linear_spring": ("stiffness",), "cubic_spring": ("stiffness",), "constant_force": ("force",),
    "cogging": ("amplitude",), "armature_error": ("armature",), "hysteresis": ("stiffness", "slip"),
    "backlash": ("gap",), "payload_mass": ("mass",), "center_of_mass_offset": ("x", "y", "z"),
    "gravity_error": ("x", "y", "z"), "actuator_bias": ("bias",), "actuator_delay": ("seconds",),
    "actuator_lag": ("time_constant",), "actuator_dead_zone": ("width",), "sensor_bias": ("bias",),
    "sensor_delay": ("seconds",), "joint_stop": ("stiffness", "damping"), "friction_pattern": ("level",),
    "periodic_disturbance": ("amplitude",), "coupling_spring": ("stiffness",),
}  # fmt: skip


def scaled(effect: Effect, factor: float) -> Effect:
    """The same effect, stronger or weaker."""
    p = dict(effect.params)
    for key in GROWS.get(effect.name, ()):
        p[key] *= factor
    if "gain" in p:
        p["gain"] = float(np.clip(1 + (p["gain"] - 1) * factor, 0.5, 1.6))
    if effect.name == "actuator_saturation":
        p["limit"] /= min(factor, 1.6)
    if "depth" in p and effect.name == "torque_ripple":
        p["depth"] = min(p["depth"] * factor, 0.9)
    if "omega" in p:
        p["omega"] = float(np.clip(p["omega"] / factor**0.5, 1.0, 80.0))
    if "drop" in p:
        p["drop"] = min(p["drop"] * factor, 2.0)
    return replace(effect, params={k: float(f"{v:.7g}") for k, v in p.items()})
