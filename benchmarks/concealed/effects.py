"""The named effects: what each does to a plant, at an amplitude that detectability sets."""

from __future__ import annotations

import numpy as np

from benchmarks.concealed.hidden import Hidden, Typical, columns, setting, units
from benchmarks.concealed.plant import A, J, Plant, S


def _friction(name: str, t: Typical, j: int, rng: np.random.Generator) -> Hidden:
    force, speed, (f, x) = t.torque[j], t.speed[j], units(t.slides[j])
    level, viscous = f, f"{f} s/{x}"
    ratio, forward = rng.uniform(0.2, 0.65), bool(rng.random() < 0.5)
    dry, excess, fall = bool(rng.random() < 0.5), rng.uniform(0.4, 1.5), rng.uniform(0.03, 0.12) * speed

    def pair(s: float) -> tuple[float, float]:
        return (s, ratio * s) if forward else (ratio * s, s)

    if name == "viscous_friction":
        return Hidden(
            name, f"joint:{t.joints[j]}", columns(j, lambda s: {J.VISCOUS: s * force / speed}),
            lambda s: {"coefficient": (s * force / speed, viscous)},
        )  # fmt: skip
    if name == "coulomb_friction":
        return Hidden(
            name, f"joint:{t.joints[j]}", columns(j, lambda s: {J.DRY_FORTH: s * force, J.DRY_BACK: s * force}),
            lambda s: {"level": (s * force, level)},
        )  # fmt: skip
    if name == "stribeck_friction":
        return Hidden(
            name, f"joint:{t.joints[j]}",
            columns(j, lambda s: {J.DRY_FORTH: s * force, J.DRY_BACK: s * force, J.STATIC: s * force * excess,
                                   J.STRIBECK: fall}),
            lambda s: {"coulomb": (s * force, level), "static": (s * force * (1 + excess), level),
                       "velocity": (fall, f"{x}/s")},
            region=lambda s: {f"qvel.{t.joints[j]}": (-fall, fall)},
        )  # fmt: skip
    if name == "quadratic_drag":
        return Hidden(
            name, f"joint:{t.joints[j]}", columns(j, lambda s: {J.QUADRATIC: s * force / speed**2}),
            lambda s: {"coefficient": (s * force / speed**2, f"{f} s2/{x}2")},
        )  # fmt: skip
    if dry:
        return Hidden(
            "asymmetric_friction", f"joint:{t.joints[j]}",
            columns(j, lambda s: {J.DRY_FORTH: pair(s)[0] * force, J.DRY_BACK: pair(s)[1] * force}),
            lambda s: {"positive_level": (pair(s)[0] * force, level), "negative_level": (pair(s)[1] * force, level)},
        )  # fmt: skip
    size = force / speed
    return Hidden(
        "asymmetric_friction", f"joint:{t.joints[j]}",
        columns(j, lambda s: {J.VISCOUS: pair(s)[1] * size, J.VISCOUS_FORTH: (pair(s)[0] - pair(s)[1]) * size}),
        lambda s: {"positive": (pair(s)[0] * size, viscous), "negative": (pair(s)[1] * size, viscous)},
    )  # fmt: skip


def _position_force(name: str, t: Typical, j: int, rng: np.random.Generator) -> Hidden:
    force, reach, (f, x), joint = t.torque[j], t.reach[j], units(t.slides[j]), t.joints[j]
    rest = rng.uniform(t.low[j], t.high[j])
    sign = rng.choice([-1.0, 1.0])
    waves, phase = rng.uniform(1.5, 6.0), rng.uniform(0, 2 * np.pi)
    periods = float(round(max(2.0, waves * np.pi / reach))) if not t.slides[j] else waves * np.pi / reach
    stiff = t.inertia[j] * rng.uniform(60, 150) ** 2
    damper = 2 * rng.uniform(0.1, 0.5) * np.sqrt(stiff * t.inertia[j])
    if name == "linear_spring":
        return Hidden(
            name, f"joint:{joint}", lambda plant, s: _add_spring(plant, j, s * force / reach, rest),
            lambda s: {"stiffness": (s * force / reach, f"{f}/{x}"), "rest": (rest, x)},
        )  # fmt: skip
    if name == "cubic_spring":
        return Hidden(
            name, f"joint:{joint}", columns(j, lambda s: {J.CUBIC: s * force / reach**3}),
            lambda s: {"stiffness": (s * force / reach**3, f"{f}/{x}3")}, most=3.0,
        )  # fmt: skip
    if name == "constant_force":
        return Hidden(
            name, f"joint:{joint}", columns(j, lambda s: {J.CONSTANT: sign * s * force}),
            lambda s: {"force": (sign * s * force, f)},
        )  # fmt: skip
    if name == "cogging":
        return Hidden(
            name, f"joint:{joint}", columns(j, lambda s: {J.COG1: s * force, J.COG1_N: periods, J.COG1_PHASE: phase}),
            lambda s: {"amplitude": (s * force, f), "periods": (periods, f"1/{x}"), "phase": (phase, "rad")},
        )  # fmt: skip
    edge = t.high[j] if sign > 0 else t.low[j]
    column, end = (J.STOP_HIGH, np.inf) if sign > 0 else (J.STOP_LOW, -np.inf)
    margin = 0.25 * reach  # an amplitude of 0 lies that far outside

    def place(s: float) -> float:
        return float(edge - sign * (s - 0.2) * margin * 4)

    return Hidden(
        "joint_stop", f"joint:{joint}",
        columns(j, lambda s: {column: place(s), J.STOP_SPRING: stiff, J.STOP_DAMPER: damper}),
        lambda s: {"position": (place(s), x), "stiffness": (stiff, f"{f}/{x}"), "damping": (damper, f"{f} s/{x}")},
        most=0.5, region=lambda s: {f"qpos.{joint}": (place(s), end) if sign > 0 else (end, place(s))},
    )  # fmt: skip


def _add_spring(plant: Plant, j: int, stiffness: float, rest: float) -> None:
    """Two springs are one: stiffness adds, the rest is where both balance."""
    row = plant.joint[j]
    total = row[J.SPRING] + stiffness
    if total > 0:
        row[J.REST] = (row[J.SPRING] * row[J.REST] + stiffness * rest) / total
    row[J.SPRING] = total


def _inertia(name: str, t: Typical, j: int, rng: np.random.Generator) -> Hidden:
    target, sign = f"body:{t.bodies[j]}", rng.choice([-1.0, 1.0])
    far, turn = bool(rng.random() < 0.5), int(rng.integers(3))
    tilt = rng.normal(size=3)
    tilt /= np.linalg.norm(tilt)
    pull = np.array([0, 0, sign]) if turn < 2 else np.array([sign, 0.0, 0.0])
    lever = float(np.linalg.norm(t.com[j]))
    along = sign * 0.5 * max(lever, 0.05) * (t.com[j] / lever if turn < 2 and lever > 1e-3 else tilt)

    def load(plant: Plant, s: float) -> None:
        tree = plant.tree
        added, at = s * tree.mass[j], tree.com[j] * (2.0 if far else 1.0)
        total = tree.mass[j] + added
        center = (tree.mass[j] * tree.com[j] + added * at) / total
        for mass, point in ((tree.mass[j], tree.com[j]), (added, at)):
            arm = point - center
            tree.inertia[j] += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        tree.mass[j], tree.com[j] = total, center

    def shift(plant: Plant, s: float) -> None:
        plant.tree.com[j] += s * along

    def gravity(plant: Plant, s: float) -> None:
        g = plant.tree.gravity.copy()
        plant.tree.gravity[:] = g + s * 9.81 * pull

    return {
        "payload_mass": Hidden(name, target, load, lambda s: {"mass": (s * t.mass[j], "kg")}, most=1.5),
        "center_of_mass_offset": Hidden(
            name, target, shift,
            lambda s: {f"offset_{axis}": (s * along[k], "m") for k, axis in enumerate("xyz") if along[k]}, most=1.2,
        ),
        "armature_error": Hidden(
            name, f"joint:{t.joints[j]}", columns(j, lambda s: {J.ROTOR: s * t.inertia[j]}),
            lambda s: {"armature": (s * t.inertia[j], "kg" if t.slides[j] else "kg m2")},
        ),
        "gravity_error": Hidden(
            name, "world", gravity,
            lambda s: {f"change_{axis}": (9.81 * s * pull[k], "m/s2") for k, axis in enumerate("xyz") if pull[k]},
            most=0.4,
        ),
    }[name]  # fmt: skip


def _actuation(name: str, t: Typical, i: int, rng: np.random.Generator) -> Hidden:
    target, sign = f"actuator:{t.actuators[i]}", rng.choice([-1.0, 1.0])
    control, most = t.control[i], t.most[i]
    gain = Hidden(
        name, target, setting("actuator", i, A.FACTOR, lambda s: 1 + sign * s),
        lambda s: {"gain": (1 + sign * s, "1")}, most=0.6,
    )  # fmt: skip
    return {
        "actuator_gain": gain,
        "actuator_bias": Hidden(
            name, target, setting("actuator", i, A.BIAS, lambda s: sign * s * control),
            lambda s: {"bias": (sign * s * control, "control")},
        ),
        "actuator_delay": Hidden(
            name, target, setting("actuator", i, A.DELAY, lambda s: 0.1 * s), lambda s: {"seconds": (0.1 * s, "s")},
        ),
        "actuator_lag": Hidden(
            name, target, setting("actuator", i, A.LAG, lambda s: 0.2 * s), lambda s: {"time_constant": (0.2 * s, "s")},
        ),
        "actuator_saturation": Hidden(
            name, target, setting("actuator", i, A.LIMIT, lambda s: most * (1.02 - s)),
            lambda s: {"limit": (most * (1.02 - s), "force")}, most=0.85,
            region=None if t.servo else lambda s: {f"|ctrl.{t.actuators[i]}|": (most * (1.02 - s), np.inf)},
        ),
        "actuator_dead_zone": Hidden(
            name, target, setting("actuator", i, A.DEAD, lambda s: s * control),
            lambda s: {"width": (s * control, "control")},
        ),
    }[name]  # fmt: skip


def _play(name: str, t: Typical, j: int, rng: np.random.Generator) -> Hidden:
    force, reach, (f, x) = t.torque[j], t.reach[j], units(t.slides[j])
    soft = rng.uniform(0.02, 0.2) * reach
    if name == "hysteresis":
        return Hidden(
            name, f"joint:{t.joints[j]}", columns(j, lambda s: {J.SLIP: s * force, J.SLIP_SPRING: s * force / soft}),
            lambda s: {"stiffness": (s * force / soft, f"{f}/{x}"), "slip": (s * force, f)},
        )  # fmt: skip
    return Hidden(
        name, f"joint:{t.joints[j]}", columns(j, lambda s: {J.GAP: 0.5 * s * reach}),
        lambda s: {"gap": (0.5 * s * reach, x)},
    )  # fmt: skip


def _sensing(name: str, t: Typical, j: int, rng: np.random.Generator) -> Hidden:
    target, sign, reach = f"sensor:{t.joints[j]}", rng.choice([-1.0, 1.0]), t.reach[j]
    x = units(t.slides[j])[1]
    return {
        "sensor_bias": Hidden(
            name, target, setting("sensor", j, S.BIAS, lambda s: sign * s * reach),
            lambda s: {"bias": (sign * s * reach, x)},
        ),
        "sensor_gain": Hidden(
            name, target, setting("sensor", j, S.GAIN, lambda s: 1 + sign * s),
            lambda s: {"gain": (1 + sign * s, "1")}, most=0.4,
        ),
        "sensor_delay": Hidden(
            name, target, setting("sensor", j, S.DELAY, lambda s: 0.1 * s), lambda s: {"seconds": (0.1 * s, "s")},
        ),
    }[name]  # fmt: skip


_FRICTION = ("viscous_friction", "coulomb_friction", "asymmetric_friction", "stribeck_friction", "quadratic_drag")
_POSITION = ("linear_spring", "cubic_spring", "constant_force", "cogging", "joint_stop")
_INERTIA = ("payload_mass", "center_of_mass_offset", "armature_error", "gravity_error")
_ACTUATION = (
    "actuator_gain", "actuator_bias", "actuator_delay", "actuator_lag", "actuator_saturation", "actuator_dead_zone",
)  # fmt: skip
_PLAY = ("backlash", "hysteresis")
_SENSING = ("sensor_bias", "sensor_gain", "sensor_delay")
_MAKERS = {
    name: maker
    for names, maker in (
        (_FRICTION, _friction), (_POSITION, _position_force), (_INERTIA, _inertia), (_ACTUATION, _actuation),
        (_PLAY, _play), (_SENSING, _sensing),
    )
    for name in names
}  # fmt: skip
NAMES = tuple(_MAKERS)

_GRAVITY = ("pendulum", "double", "arm3", "arm7", "cartpole")
_EVERYWHERE = ("pendulum", "cartpole", "slide", "planar", "double", "arm3", "arm7", "striker")
_MOTORED = ("pendulum", "cartpole", "slide", "planar", "double", "arm3", "striker")
HOMES = {name: _EVERYWHERE for name in NAMES} | {
    "gravity_error": _GRAVITY,
    "center_of_mass_offset": ("pendulum", "double", "arm3", "planar", "cartpole", "arm7"),
    "actuator_gain": _MOTORED,
    "actuator_dead_zone": _MOTORED,
    "backlash": ("pendulum", "slide", "planar", "double", "arm3"),
    "sensor_bias": ("pendulum", "double", "arm3", "planar", "striker"),
    "joint_stop": ("pendulum", "cartpole", "slide", "planar", "double", "arm3", "arm7"),
}
"""Machines on which an effect can show at all."""


def draw_effect(name: str, t: Typical, rng: np.random.Generator) -> Hidden:
    """Draw target and shape of a named effect."""
    if name in _ACTUATION:
        return _actuation(name, t, int(rng.integers(len(t.actuators))), rng)
    driven = name == "backlash" and len(t.actuators) < len(t.joints)
    j = 0 if driven else int(rng.integers(len(t.joints)))
    return _MAKERS[name](name, t, j, rng)
