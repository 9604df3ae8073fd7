"""What can be missing from the nominal model, and how it changes the machine that makes the recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.unseen.machine import Machine
from benchmarks.unseen.memories import Heat, Play, Ripple, SecondOrder, Slider
from benchmarks.unseen.plant import Force, Plant
from benchmarks.unseen.solids import point
from benchmarks.unseen.tree import Link

Array = np.ndarray
Law = Callable[[Plant, int, dict[str, float]], None]


@dataclass(frozen=True)
class Effect:
    """A name, where it is ("joint:elbow"), and numbers."""

    name: str
    target: str
    params: dict[str, float]

    @property
    def where(self) -> str:
        """The target's own name."""
        return self.target.partition(":")[2]


def _joint_force(law: Callable[[Array, Array], Array], j: int) -> Force:
    def force(t: Array, q: Array, v: Array) -> Array:
        f = np.zeros_like(q)
        f[:, j] = law(q[:, j], v[:, j])
        return f

    return force


def _viscous(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.forces.append(_joint_force(lambda q, v: -p["coefficient"] * v, j))


def _quadratic(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.forces.append(_joint_force(lambda q, v: -p["coefficient"] * v * np.abs(v), j))


def _coulomb(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.friction.plus[j] += p["level"]
    plant.friction.minus[j] += p["level"]


def _asymmetric(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.friction.plus[j] += p["level_plus"]
    plant.friction.minus[j] += p["level_minus"]


def _stribeck(plant: Plant, j: int, p: dict[str, float]) -> None:
    _coulomb(plant, j, {"level": p["coulomb"]})
    plant.friction.excess[j] = p["static"] - p["coulomb"]
    plant.friction.speed[j] = p["velocity"]


def _spring(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.forces.append(_joint_force(lambda q, v: -p["stiffness"] * (q - p["rest"]), j))


def _cubic(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.forces.append(_joint_force(lambda q, v: -p["stiffness"] * q**3, j))


def _constant(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.forces.append(_joint_force(lambda q, v: np.full_like(q, p["force"]), j))


def _cogging(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.forces.append(_joint_force(lambda q, v: p["amplitude"] * np.sin(p["waves"] * q + p["phase"]), j))


def _stop(plant: Plant, j: int, p: dict[str, float]) -> None:
    side = p["side"]

    def law(q: Array, v: Array) -> Array:
        deep = np.maximum(side * (q - p["position"]), 0.0)
        push = p["stiffness"] * deep + np.where(deep > 0, p["damping"] * side * v, 0.0)
        return -side * np.maximum(push, 0.0)

    plant.forces.append(_joint_force(law, j))


def _armature(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.armature = plant.armature + p["armature"] * np.eye(plant.tree.n)[j]


def _hysteresis(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.memories.append(Slider(j, p["stiffness"], p["slip"]))


def _backlash(plant: Plant, j: int, p: dict[str, float]) -> None:
    inertia = float(plant.armature[j])
    plant.armature = plant.armature * (1 - np.eye(plant.tree.n)[j])
    plant.memories.append(Play(j, inertia, p["gap"], p["stiffness"], p["damping"]))


def _gain(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.chain.gain[a] *= p["gain"]


def _bias(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.chain.bias[a] += p["bias"]


def _delay(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.chain.delay[a] = p["seconds"]


def _lag(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.chain.lag[a] = p["time_constant"]


def _saturation(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.chain.limit[a] = p["limit"]


def _dead(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.chain.dead[a] = p["width"]


def _sensor_bias(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.sensor_bias[j] += p["bias"]


def _sensor_gain(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.sensor_gain[j] *= p["gain"]


def _sensor_delay(plant: Plant, j: int, p: dict[str, float]) -> None:
    plant.sensor_delay[j] = p["seconds"]


def _pattern(plant: Plant, j: int, p: dict[str, float]) -> None:
    _coulomb(plant, j, p)
    plant.friction.wave[j], plant.friction.waves[j] = p["depth"], p["waves"]


def _disturbance(plant: Plant, j: int, p: dict[str, float]) -> None:
    def force(t: Array, q: Array, v: Array) -> Array:
        f = np.zeros_like(q)
        start = 2.399963 * np.arange(len(q)) + p["phase"]  # not in step with the runs
        f[:, j] = p["amplitude"] * np.sin(2 * np.pi * p["hertz"] * t + start)
        return f

    plant.forces.append(force)


def _coupling(plant: Plant, j: int, p: dict[str, float]) -> None:
    def force(t: Array, q: Array, v: Array) -> Array:
        f = np.zeros_like(q)
        pull = p["stiffness"] * (q[:, j] - p["ratio"] * q[:, j + 1] - p["rest"])
        f[:, j], f[:, j + 1] = -pull, p["ratio"] * pull
        return f

    plant.forces.append(force)


def _second_order(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.memories.append(SecondOrder(a, p["omega"], p["zeta"]))


def _heat(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.memories.append(Heat(a, p["scale"], p["drop"], p["seconds"]))


def _ripple(plant: Plant, a: int, p: dict[str, float]) -> None:
    plant.memories.append(Ripple(int(plant.joint_of[a]), p["depth"], p["waves"]))


LAWS: dict[str, Law] = {
    "viscous_friction": _viscous, "quadratic_drag": _quadratic, "coulomb_friction": _coulomb,
    "asymmetric_friction": _asymmetric, "stribeck_friction": _stribeck, "linear_spring": _spring,
    "cubic_spring": _cubic, "constant_force": _constant, "cogging": _cogging, "joint_stop": _stop,
    "armature_error": _armature, "hysteresis": _hysteresis, "backlash": _backlash, "actuator_gain": _gain,
    "actuator_bias": _bias, "actuator_delay": _delay, "actuator_lag": _lag, "actuator_saturation": _saturation,
    "actuator_dead_zone": _dead, "sensor_bias": _sensor_bias, "sensor_gain": _sensor_gain,
    "sensor_delay": _sensor_delay,
    # not on the tool's list
    "friction_pattern": _pattern, "periodic_disturbance": _disturbance, "coupling_spring": _coupling,
    "second_order_drive": _second_order, "thermal_gain": _heat, "torque_ripple": _ripple,
}  # fmt: skip
BODY = ("payload_mass", "center_of_mass_offset", "gravity_error")
"""Effects on inertia and weight."""


def _links(machine: Machine, effects: Sequence[Effect]) -> tuple[list[Link], Array]:
    links, gravity = machine.links(), np.asarray(machine.gravity, float)
    for effect in effects:
        p = effect.params
        if effect.name == "gravity_error":
            gravity = gravity + np.array([p["x"], p["y"], p["z"]])
        if effect.name == "payload_mass":
            i = machine.body(effect.where)
            at = np.array([p["x"], p["y"], p["z"]])
            links[i] = replace(links[i], solid=links[i].solid + point(p["mass"], at))
        if effect.name == "center_of_mass_offset":
            i = machine.body(effect.where)
            links[i] = replace(links[i], solid=links[i].solid.moved(np.array([p["x"], p["y"], p["z"]])))
    return links, gravity


def truth(machine: Machine, effects: Sequence[Effect]) -> Plant:
    """The machine with these effects."""
    links, gravity = _links(machine, effects)
    plant = machine.plant(links=links, gravity=gravity)
    for effect in effects:
        if effect.name in BODY:
            continue
        kind = effect.target.partition(":")[0]
        index = machine.motor(effect.where) if kind == "actuator" else machine.joint(effect.where)
        LAWS[effect.name](plant, index, effect.params)
    return plant
