"""The next recording: controls that tell the leading rivals apart."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from torch_activegp.diagnosis.engine import Candidate, Engine
from torch_activegp.diagnosis.fit import Fit
from torch_activegp.diagnosis.noise_model import NoiseModel
from torch_activegp.diagnosis.runs import Array, Run, input_addresses
from torch_activegp.diagnosis.segments import Segments, cut

SECONDS = 5.0
_TRIALS = 24
_LEAST = 4.0
"""Models that differ by less chi2 than this are not told apart by one more recording."""


def next_experiment(
    engine: Engine, rivals: list[Fit], runs: tuple[Run, ...], noise: NoiseModel, seed: int, cheap: Engine | None = None
) -> tuple[dict[str, Any], str] | None:
    """Chooses, among random multisines within the actuators' limits, the control under which two models differ most.

    This is the acquisition of the exploring loop with the rivals' predicted difference in place of the discrepancy.

    Args:
        engine: the precise simulation; says what the chosen trial gains.
        rivals: two fits to be separated.
        runs: recordings, for the time step, the limits and the initial state.
        noise: of the recordings.
        seed: of the random controls.
        cheap: simulates all trials, to choose one.

    Returns:
        The entry of ``diagnosis.json`` and the CSV text; None for a machine without controls, without two
        rivals, or where no trial tells them apart.
    """
    model = engine.model
    if model.nu == 0 or len(rivals) < 2:
        return None
    step = float(np.median(runs[0].dt))
    rows = round(SECONDS / step) + 1
    low, high = _limits(engine, runs)
    rng = np.random.default_rng(seed)
    time: Array = step * np.arange(rows, dtype=float)
    trials = [_multisine(rng, time, low, high) for _ in range(_TRIALS)]
    start = engine.starts(cut([runs[0]], 1e9, 0.0))[0]
    joints = len(engine.channels.joints)
    made = [
        Run(
            f"trial {i}",
            time,
            np.zeros((rows, joints)),
            np.ones(rows, dtype=bool),
            np.zeros((rows, joints)),
            np.tile(start[engine.channels.qpos], (rows, 1)),
            control,
            np.zeros((rows - 1, model.nv)),
            noise.scale,
        )
        for i, control in enumerate(trials)
    ]
    segments = cut(made, 1e9, 0.0)
    states = np.repeat(start[None, None], segments.size, axis=1)
    both = [Candidate(fit.effects, fit.values) for fit in rivals[:2]]
    states = np.repeat(states, 2, axis=0)
    best = int(np.argmax(_apart(cheap or engine, segments, states, both, noise)))
    gain = float(_apart(engine, segments.pick(np.array([best])), states[:, [best]], both, noise)[0])
    if gain < _LEAST:
        return None
    words = [_beyond(rivals[0], rivals[1]), _beyond(rivals[1], rivals[0])]
    entry = {
        "separates": words,
        "why": (
            f"{words[0]} and {words[1]} predict positions that differ by chi2 = {gain:.3g} under these controls "
            f"({SECONDS:g} s, within the limits seen of controls, not of positions: simulate them first); "
            f"start where {runs[0].label} started."
        ),
        "controls": "next.csv",
        "predicted_gain": gain,
    }
    return entry, _csv(engine, time, trials[best])


def _beyond(fit: Fit, other: Fit) -> str:
    """What a set has beyond another one, in names, with places where the other one has the name elsewhere."""
    there = {name for name, _ in other.keys - fit.keys}
    words = [f"{name} at {target}" if name in there else name for name, target in sorted(fit.keys - other.keys)]
    return " + ".join(words) or ("the rest alone" if fit.effects else "no effect")


def _apart(engine: Engine, segments: Segments, starts: Array, both: list[Candidate], noise: NoiseModel) -> Array:
    """By how much chi2 two models differ in each trial, ``(S,)``; 0 where a simulation fails."""
    one, other = engine.predict(segments, starts, both)[0]
    return np.asarray(np.nan_to_num((((one - other) / noise.scale) ** 2).sum(axis=(1, 2)), posinf=0.0))


def _limits(engine: Engine, runs: tuple[Run, ...]) -> tuple[Array, Array]:
    """Least and largest control, ``(nu,)`` each: as large as was seen, and within the actuators' limits."""
    model = engine.model
    seen = np.max([np.abs(run.control).max(axis=0) for run in runs], axis=0)
    limited = model.actuator_ctrllimited.astype(bool)
    reach = np.where(limited & (seen == 0), np.inf, seen)
    low, high = model.actuator_ctrlrange.T
    return np.where(limited, np.maximum(low, -reach), -reach), np.where(limited, np.minimum(high, reach), reach)


def _multisine(rng: np.random.Generator, time: Array, low: Array, high: Array) -> Array:
    frequency = rng.uniform(0.1, 3.0, (4, len(low)))
    phase = rng.uniform(0, 2 * np.pi, (4, len(low)))
    weight = rng.dirichlet(np.ones(4), len(low)).T
    waves = (weight * np.sin(2 * np.pi * frequency * time[:-1, None, None] + phase)).sum(axis=1)
    return np.asarray(0.5 * (low + high) + 0.5 * (high - low) * waves * rng.uniform(0.3, 1.0))


def _csv(engine: Engine, time: Array, control: Array) -> str:
    out = io.StringIO()
    inputs = input_addresses(engine.model)
    table = np.column_stack([time, np.vstack([control, control[-1:]])[:, list(inputs.values())]])
    header = ",".join(["time", *(f"ctrl.{name}" for name in inputs)])
    np.savetxt(out, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return out.getvalue()
