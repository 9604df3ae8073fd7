"""The bench's pendulum against a stop, with a tenth of the noise."""

from __future__ import annotations

import dataclasses

import numpy as np

from tests.diagnosis.conftest import INERTIA, NOISE, RATE, XML, Bench, assemble
from torch_activegp.data import Recording

AT, STIFFNESS, DAMPING = 0.3, 60.0, 1.5


def strikes(seed: int) -> Recording:
    """The pendulum of the bench against a stop, by the semi-implicit Euler scheme in steps of 20 us."""
    rng, h = np.random.default_rng(seed), 2e-5
    time = np.arange(4 * RATE + 1) / RATE
    control = 2.0 * np.sin(2 * np.pi * rng.uniform(0.6, 0.9) * time + rng.uniform(0, 2 * np.pi))
    q, v, angles = 0.0, 0.0, []
    for u in control:
        angles.append(q)
        for _ in range(round(1 / RATE / h)):
            stop = max(STIFFNESS * (q - AT) + DAMPING * v, 0.0) if q > AT else 0.0
            v += h * (u - 9.81 * 0.5 * np.sin(q) - stop) / INERTIA
            q += h * v
    assert max(angles) > AT + 0.02
    noisy = np.array(angles) + 0.1 * NOISE * rng.normal(size=len(time))
    return Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": noisy, "ctrl.drive": control})


def struck_bench() -> Bench:
    made = assemble("stop", XML, [strikes(seed) for seed in range(3)], strikes(9))
    noise = dataclasses.replace(made.shooting.noise, scale=0.1 * made.shooting.noise.scale)
    return dataclasses.replace(made, shooting=dataclasses.replace(made.shooting, noise=noise))
