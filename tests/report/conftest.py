"""Made-up diagnoses, one for each verdict, as a real one would look."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

Fake = tuple[dict[str, Any], dict[str, Any]]

DIFF = """--- arm.xml
+++ corrected.xml
@@ -11,7 +11,7 @@
     <body name="forearm" pos="0 0 -0.3">
-      <joint name="elbow" type="hinge" axis="0 1 0" damping="0.02"/>
+      <joint name="elbow" type="hinge" axis="0 1 0" damping="0.034" frictionloss="0.31"/>
       <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
"""
COULOMB = {
    "name": "coulomb_friction",
    "target": "joint:elbow",
    "share": 0.91,
    "probability": 0.98,
    "law": "-F sign(v), with sticking",
    "mjcf": True,
    "parameters": {"level": {"value": 0.312, "unit": "N m", "ci95": [0.293, 0.331]}},
    "ties": [],
}
VISCOUS = {
    "name": "viscous_friction",
    "target": "joint:elbow",
    "parameters": {"coefficient": {"value": 0.0342, "unit": "N m s/rad", "ci95": [0.0311, 0.0373]}},
}
DELAY = {
    "name": "actuator_delay",
    "target": "actuator:shoulder_motor",
    "share": 0.07,
    "probability": 0.96,
    "law": "u(t - T)",
    "mjcf": False,
    "parameters": {"seconds": {"value": 0.0121, "unit": "s", "ci95": [0.0102, 0.0139]}},
    "ties": [],
}
GAIN = {
    "name": "actuator_gain",
    "target": "actuator:shoulder_motor",
    "share": 0.88,
    "probability": 0.52,
    "law": "g u",
    "mjcf": True,
    "parameters": {"gain": {"value": 0.83, "unit": "", "ci95": [0.8, 0.86]}},
    "ties": [{"name": "payload_mass", "target": "body:forearm"}],
}


def _base(verdict: str) -> dict[str, Any]:
    noise = {"qpos.shoulder": 3.1e-4, "qpos.elbow": 2.8e-4}
    runs = [
        {"name": f"bench_{index:02d}.csv", "role": "fit", "rows": 2400, "seconds": 4.8, "rate_hz": 500.0, "notes": []}
        for index in range(1, 7)
    ]
    runs[3]["notes"] = ["a gap of 0.12 s at 2.31 s splits it"]
    runs += [{**runs[0], "name": f"test_{index}.csv", "role": "holdout"} for index in (1, 2)]
    return {
        "schema_version": 1,
        "verdict": verdict,
        "mismatch": {"detected": verdict != "none", "p_value": 1e-9, "chi2_per_dof": 8.13, "noise": noise},
        "location": [],
        "effects": [],
        "unexplained": {"share": 0.02, "white": True},
        "fit": {"holdout": _holdout(2.4, 0.002, 0.002)},
        "next_experiment": None,
        "model": {"name": "arm.xml", "source": "models/arm.xml"},
        "recordings": runs,
        "notes": [
            "The encoder of the elbow is filtered: the noise floor is taken above the filter.",
            "The model runs at 2 ms; the recordings at 500 Hz need no resampling.",
        ],
        "rivals": [],
        "retuned": [],
        "stability": None,
        "mjcf_diff": None,
    }


def _holdout(before: float, after: float, noise: float) -> dict[str, Any]:
    errors = {
        "one_step": {"before": before / 12, "after": max(after, noise) * 1.02, "noise": noise},
        "free_run": {"before": before, "after": after, "noise": noise},
    }
    runs = [
        {"run": f"test_{i}.csv", "channel": f"qpos.{name}", **errors} for i in (1, 2) for name in ("shoulder", "elbow")
    ]
    return {**errors, "runs": runs}


def _rivals(*entries: tuple[list[dict[str, Any]], float, float, float]) -> list[dict[str, Any]]:
    return [
        {
            "effects": [{"name": effect["name"], "target": effect["target"]} for effect in effects],
            "chi2_per_dof": chi2,
            "delta_bic": bic,
            "probability": probability,
        }
        for effects, chi2, bic, probability in entries
    ]


def _evidence(scale: float, left: float = 1.0) -> dict[str, Any]:
    random = np.random.default_rng(7)
    centres = np.arange(0.2, 4.8, 0.4)
    wave = np.abs(np.sin(1.3 * centres)) * scale
    times = [
        {
            "run": name,
            "time": centres.tolist(),
            "before": (1 + wave * random.uniform(0.3, 1.6, centres.size)).tolist(),
            "after": (left * random.chisquare(20, centres.size) / 20).tolist(),
        }
        for name in ("bench_01.csv", "bench_02.csv", "bench_03.csv", "bench_04.csv", "test_1.csv", "test_2.csv")
    ]
    regions = []
    for channel, over, reach in (
        ("joint:elbow", "qvel.elbow", 4.0),
        ("joint:elbow", "qpos.elbow", 1.6),
        ("joint:shoulder", "qvel.shoulder", 3.0),
    ):
        edges = np.linspace(-reach, reach, 17)
        middle = (edges[1:] + edges[:-1]) / 2
        strength = (
            scale * (1 - 0.7 * np.exp(-((middle / reach) ** 2) * 30)) if channel == "joint:elbow" else 0.1 * scale
        )
        regions.append(
            {
                "channel": channel,
                "over": over,
                "edges": edges.tolist(),
                "before": (1 + strength * random.uniform(0.8, 1.2, 16)).tolist(),
                "after": (left * random.uniform(0.85, 1.15, 16)).tolist(),
                "count": [0, *[120] * 15],
            }
        )
    return {"map_time": times, "map_region": regions, "laws": [], "traces": _traces(scale, left)}


def _traces(scale: float, left: float) -> list[dict[str, Any]]:
    random = np.random.default_rng(3)
    time = np.arange(2400) / 500
    found = []
    for run, phase in (("test_1.csv", 0.3), ("test_2.csv", 1.1)):
        for channel, size, share in (("qpos.elbow", 1.1, 1.0), ("qpos.shoulder", 0.6, 0.2)):
            truth = size * np.sin(2.1 * time + phase) * np.exp(-0.15 * time) + 0.2 * np.sin(5.3 * time)
            measured = truth + 3e-4 * random.standard_normal(time.size)
            drift = 0.05 * min(scale, 8.0) * share * size * np.sin(2.3 * time) * (1 - np.exp(-0.8 * time))
            rest = 4e-4 * left * np.sin(1.7 * time) * time / 5
            found.append(
                {
                    "run": run,
                    "channel": channel,
                    "unit": "rad",
                    "time": time.tolist(),
                    "measured": measured.tolist(),
                    "before": (truth + drift).tolist(),
                    "after": (truth + rest).tolist(),
                    "gp": None,
                    "noise": 3e-4,
                }
            )
    return found


def _law(name: str, target: str) -> dict[str, Any]:
    random = np.random.default_rng(5)
    speed = np.linspace(-4, 4, 44)
    force = -0.312 * np.sign(speed) * (1 - np.exp(-60 * np.abs(speed))) + 0.035 * random.standard_normal(44)
    dense = np.linspace(-4, 4, 400)
    return {
        "name": name,
        "target": target,
        "over": "qvel.elbow",
        "unit_x": "rad/s",
        "unit_y": "N m",
        "x": speed.tolist(),
        "force": force.tolist(),
        "force_sd": [0.035] * 44,
        "law_x": dense.tolist(),
        "law_y": (-0.312 * np.sign(dense)).tolist(),
    }


def _delay_law() -> dict[str, Any]:
    random = np.random.default_rng(9)
    rate = random.standard_normal(900) * 3
    force = -0.02 * rate + 0.03 * random.standard_normal(900)
    points = {"x": rate.tolist(), "force": force.tolist(), "law_x": [-9.0, 9.0], "law_y": [0.18, -0.18]}
    where = {"over": "ctrl.shoulder_motor", "unit_x": "V", "force_sd": []}
    return _law("actuator_delay", "actuator:shoulder_motor") | where | points


def named() -> Fake:
    diagnosis = _base("named") | {
        "sentence": "Coulomb friction at joint elbow and actuator delay at actuator shoulder_motor explain 98 % of the "
        "mismatch.",
        "location": [
            {"target": "joint:elbow", "share": 0.91, "region": {"qvel.elbow": [-4.0, 4.0]}, "q_value": 1e-14},
            {"target": "actuator:shoulder_motor", "share": 0.07, "region": {}, "q_value": 0.0021},
            {"target": "joint:shoulder", "share": 0.004, "region": {"qvel.shoulder": [-0.11, 0.09]}, "q_value": 0.31},
        ],
        "effects": [COULOMB, DELAY],
        "rivals": _rivals(
            ([COULOMB, DELAY, VISCOUS], 1.004, 0.0, 0.96),
            ([COULOMB, VISCOUS], 1.31, 11.8, 0.03),
            ([{"name": "stribeck_friction", "target": "joint:elbow"}, DELAY, VISCOUS], 1.005, 13.9, 0.009),
            ([{"name": "hysteresis", "target": "joint:elbow"}], 2.2, 171.0, 1e-7),
            ([VISCOUS, DELAY], 3.9, 640.2, 0.0),
            ([], 8.13, 2210.0, 0.0),
        ),
        "retuned": [VISCOUS],
        "stability": {
            "left_out": [f"bench_{index:02d}.csv" for index in range(1, 7)],
            "effects": [
                {
                    "name": "coulomb_friction",
                    "target": "joint:elbow",
                    "gains": [310.2, 290.8, 402.1, 388.0, 275.3, 301.9],
                    "rests_on": [],
                    "parameters": {"level": {"low": 0.308, "high": 0.315, "shift": 0.42, "farthest": "bench_03.csv"}},
                },
                {
                    "name": "actuator_delay",
                    "target": "actuator:shoulder_motor",
                    "gains": [-1.2, 0.4, 2.1, None, 0.9, -0.3],
                    "rests_on": ["bench_04.csv"],
                    "parameters": {
                        "seconds": {"low": 0.0098, "high": 0.0131, "shift": 2.9, "farthest": "bench_01.csv"}
                    },
                },
            ],
            "sentence": "Each recording left out in turn and forecast from the rest: coulomb_friction at joint:elbow "
            "improves 6 of 6, actuator_delay at actuator:shoulder_motor improves 3 of 6; actuator_delay at "
            "actuator:shoulder_motor rests on bench_04.csv alone: the rest shows no sign of it.",
            "sound": False,
        },
        "mjcf_diff": DIFF,
    }
    evidence = _evidence(40.0) | {"laws": [_law("coulomb_friction", "joint:elbow"), _delay_law()]}
    return diagnosis, evidence


def none() -> Fake:
    diagnosis = _base("none")
    diagnosis["mismatch"] |= {"detected": False, "p_value": 0.43, "chi2_per_dof": 1.003}
    diagnosis["unexplained"] = {"share": 0.0, "white": True}
    diagnosis["fit"] = {"holdout": _holdout(0.0021, 0.0021, 0.002)}
    diagnosis["rivals"] = _rivals(([], 1.003, 0.0, 0.93), ([COULOMB], 1.002, 7.9, 0.04), ([VISCOUS], 1.003, 9.1, 0.03))
    evidence = _evidence(0.05)
    for trace in evidence["traces"]:
        trace["before"] = trace["after"]
    return diagnosis, evidence


def tie() -> Fake:
    diagnosis = _base("tie") | {
        "effects": [GAIN],
        "location": [{"target": "joint:shoulder", "share": 0.93, "region": {}, "q_value": 1e-6}],
        "unexplained": {"share": 0.12, "white": True},
        "rivals": _rivals(
            ([GAIN], 1.01, 0.0, 0.52),
            ([{"name": "payload_mass", "target": "body:forearm"}], 1.01, 0.2, 0.47),
            ([COULOMB], 4.2, 390.0, 0.0),
            ([], 8.13, 800.0, 0.0),
        ),
        "next_experiment": {
            "separates": ["actuator_gain", "payload_mass"],
            "why": "Let the arm swing with the motor off: a heavier forearm swings otherwise, a weaker motor does not.",
            "controls": "next.csv",
        },
        "mjcf_diff": DIFF,
    }
    return diagnosis, _evidence(20.0)


def unknown() -> Fake:
    diagnosis = _base("unknown") | {
        "effects": [COULOMB | {"share": 0.22, "probability": 0.84}],
        "location": [{"target": "joint:elbow", "share": 0.83, "region": {"qpos.elbow": [0.41, 0.62]}, "q_value": 1e-8}],
        "unexplained": {"share": 0.74, "white": False},
        "fit": {"holdout": _holdout(0.31, 0.18, 0.002)},
        "rivals": _rivals(([COULOMB], 6.4, 0.0, 0.84), ([], 8.13, 96.0, 0.0)),
        "next_experiment": {
            "separates": [],
            "why": "Cross 0.4 to 0.6 rad slowly in both directions, where the unexplained force lives.",
            "controls": "next.csv",
        },
        "retuned": [VISCOUS],
    }
    evidence = _evidence(12.0, left=6.0)
    for trace in evidence["traces"]:
        measured = np.array(trace["measured"])
        trace["gp"] = (measured + 0.2 * (np.array(trace["after"]) - measured)).tolist()
        trace["after"] = (measured + 0.5 * (np.array(trace["before"]) - measured)).tolist()
    return diagnosis, evidence


FAKES: dict[str, Callable[[], Fake]] = {"none": none, "named": named, "tie": tie, "unknown": unknown}


@pytest.fixture
def fakes() -> dict[str, Callable[[], Fake]]:
    """A maker of a diagnosis and its evidence for each verdict."""
    return FAKES
