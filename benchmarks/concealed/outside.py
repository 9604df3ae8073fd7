"""Effects that are in no list: the right answer is that there is something, where, and that no name fits."""

from __future__ import annotations

import numpy as np

from benchmarks.concealed.hidden import Hidden, Typical
from benchmarks.concealed.plant import A, J, Plant

JOINT_KINDS = ("magnet_bump", "hum", "negative_pocket", "loaded_friction", "swirl", "cross_coupling", "creep")
ACTUATOR_KINDS = ("gain_drift", "actuator_ripple")
OUTSIDE = JOINT_KINDS + ACTUATOR_KINDS


def draw_outside(name: str, t: Typical, rng: np.random.Generator) -> Hidden:
    """Draw target and shape of an effect outside of the list."""
    if name in ACTUATOR_KINDS:
        return _actuator_kind(name, t, int(rng.integers(len(t.actuators))), rng)
    j = int(rng.integers(len(t.joints)))
    if name == "loaded_friction" and len(t.actuators) < len(t.joints):
        j = 0
    force, reach, speed = t.torque[j], t.reach[j], t.speed[j]
    at, width = rng.uniform(0.7 * t.low[j] + 0.3 * t.high[j], t.high[j]), rng.uniform(0.05, 0.2) * reach
    hertz, phase, waves = rng.uniform(0.5, 5.0), rng.uniform(0, 2 * np.pi), rng.uniform(2, 6) / reach
    other, time = (j + 1) % len(t.joints), rng.uniform(0.3, 1.5)
    columns = {
        "magnet_bump": lambda s: {J.BUMP: 3 * s * force, J.BUMP_AT: at, J.BUMP_WIDTH: width},
        "hum": lambda s: {J.HUM: s * force, J.HUM_HZ: hertz, J.HUM_PHASE: phase},
        "negative_pocket": lambda s: {J.POCKET: s * force / width, J.POCKET_AT: at, J.POCKET_WIDTH: width},
        "loaded_friction": lambda s: {J.LOADED: s},
        "swirl": lambda s: {J.SWIRL: s * force / speed, J.SWIRL_N: waves},
        "cross_coupling": lambda s: {J.CROSS: s * force / t.reach[other], J.CROSS_WITH: other},
        "creep": lambda s: {J.CREEP: s * force / reach, J.CREEP_TIME: time},
    }[name]

    def change(plant: Plant, s: float) -> None:
        for column, value in columns(s).items():
            plant.joint[j, column] = value

    local = {"magnet_bump": 1.5 * width, "negative_pocket": width}.get(name)
    region = None if local is None else (lambda s: {f"qpos.{t.joints[j]}": (at - local, at + local)})
    return Hidden(name, f"joint:{t.joints[j]}", change, lambda s: {"amplitude": (s, "1")}, region=region)


def _actuator_kind(name: str, t: Typical, i: int, rng: np.random.Generator) -> Hidden:
    waves, sign = rng.uniform(3.0, 8.0) / max(t.control[i], 1e-9), rng.choice([-1.0, 1.0])

    def change(plant: Plant, s: float) -> None:
        if name == "gain_drift":
            plant.actuator[i, A.DRIFT] = 0.15 * sign * s
        else:
            plant.actuator[i, A.RIPPLE], plant.actuator[i, A.RIPPLE_N] = s * t.control[i], waves

    return Hidden(name, f"actuator:{t.actuators[i]}", change, lambda s: {"amplitude": (s, "1")}, most=1.0)
