"""The next recording: controls that tell the leading rivals apart."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Array, Run, input_addresses
from torch_activegp.diagnosis.inputs.segments import Segments, cut
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

SECONDS = 5.0
_TRIALS, _REPLAYED = 16, 8
_BESIDE = 0.3
"""Largest part of a multisine that is added to the recorded control: what drifts away under any other stays nearer so,
the nearer the less is added."""
_NEAR = 0.5
_AS_NEAR, _STILL = 0.1, 100.0
"""Parts of what is near by which trials that leave it may differ and be as near; and times the noise that a joint has
of it at least, which stood still."""
_LEAST = 4.0
"""Models that differ by less chi2 than this are not told apart by one more recording."""


class Trial(NamedTuple):
    """A recording that may be made.

    Args:
        gain: chi2 by which two models differ in it.
        run: its clock and controls.
        start: where it begins, ``(nq + nv,)``.
    """

    gain: float
    run: Run
    start: Array


class Telling(NamedTuple):
    """What is learned where two models are told apart.

    Args:
        separates: the two in words.
        said: what is said of the recording that does so, and whether it is worth making.
    """

    separates: list[str]
    said: Callable[[Trial], tuple[str, bool]]


def next_experiment(
    engine: Engine,
    rivals: list[Fit],
    runs: tuple[Run, ...],
    noise: NoiseModel,
    seed: int,
    cheap: Engine | None = None,
    telling: Telling | None = None,
) -> tuple[dict[str, Any], str] | None:
    """Chooses, among random multisines within the actuators' limits, the control under which two models differ most.

    Some of them are added to the control of the first recording. Controls stay within those seen and within the
    actuators' limits, around their mean. Those under which both models stay near the positions seen go before all
    others; where none does, those that tell and leave them least are chosen.

    This is the acquisition of the exploring loop with the rivals' predicted difference in place of the discrepancy.

    Args:
        engine: the precise simulation; says what the chosen trial gains.
        rivals: two fits to be separated.
        runs: recordings, for the time step, the limits and the initial state.
        noise: of the recordings.
        seed: of the random controls.
        cheap: simulates all trials, to choose one.
        telling: what is told, in place of the names that one model has beyond the other.

    Returns:
        The entry of ``diagnosis.json`` and the CSV text; None for a machine without controls, without two
        rivals, or where no trial tells them apart.
    """
    model = engine.model
    if model.nu == 0 or len(rivals) < 2:
        return None
    step = float(np.median(runs[0].dt))
    rows = round(SECONDS / step) + 1
    low, middle, high = _limits(engine, runs)
    rng = np.random.default_rng(seed)
    time: Array = step * np.arange(rows, dtype=float)
    trials = [_multisine(rng, time, low, middle, high) for _ in range(_TRIALS)]
    before = _replayed(runs[0], rows - 1, middle)
    parts = np.linspace(_BESIDE, 0.0, _REPLAYED, endpoint=False)
    aside = [part * (_multisine(rng, time, low, middle, high) - middle) for part in parts]
    trials += [np.clip(before + more, low, high) for more in aside]
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
    reach = _reach(engine, runs)
    apart, away = _apart(cheap or engine, segments, states, both, noise, reach)
    width = np.maximum(np.ptp(reach, axis=0), _STILL * noise.scale)
    best = _chosen(apart, (away / width).max(axis=1))
    gains, away = _apart(engine, segments.pick(np.array([best])), states[:, [best]], both, noise, reach)
    if gains[0] < _LEAST:
        return None
    told = telling or _names(rivals[0], rivals[1])
    trial = Trial(float(gains[0]), made[best], start)
    sentence, needed = told.said(trial)
    seen, caution = "of controls and near the positions seen", ""
    if (away[0] > 0.0).any():
        seen, caution = "of controls", f". Simulate these controls first: {_leaving(engine, away[0], width)}"
    entry = {
        "separates": told.separates,
        "why": (
            f"{sentence} ({SECONDS:g} s, within the limits seen {seen}); start where {runs[0].label} started{caution}."
        ),
        "needed": needed,
        "controls": "next.csv",
        "predicted_gain": trial.gain,
    }
    return entry, _csv(engine, time, trials[best])


def _chosen(apart: Array, astray: Array) -> int:
    """The trial that tells most of those that stay near; where none of these tells, of those that leave it least.

    Args:
        apart: chi2 by which two models differ, ``(S,)``.
        astray: how far the machine leaves what is near, in parts of that range, ``(S,)``.
    """
    tells = apart >= _LEAST
    if not tells.any():
        return int(np.argmax(apart))
    least = float(astray[tells].min())
    near = tells & (astray <= (least + _AS_NEAR if least > 0.0 else 0.0))
    return int(np.argmax(np.where(near, apart, 0.0)))


def _replayed(run: Run, rows: int, rest: Array) -> Array:
    """The control of a run, ``(rows, nu)``; at rest after its end."""
    out = np.tile(rest, (rows, 1))
    out[: len(run.control)] = run.control[:rows]
    return out


def _leaving(engine: Engine, away: Array, width: Array) -> str:
    """Which joint goes how far beyond what is near, from excesses and widths of that ``(C,)``, m or rad."""
    worst = int(np.argmax(away / width))
    unit = "rad" if engine.channels.hinge[worst] else "m"
    far = f"by {away[worst]:.3g} {unit}" if np.isfinite(away[worst]) else "for good"
    joint = engine.channels.joints[worst]
    return f"none were found that tell and keep the machine near; {joint} leaves the positions seen {far}"


def _names(one: Fit, other: Fit) -> Telling:
    """Two sets by what each has beyond the other."""
    words = [_beyond(one, other), _beyond(other, one)]
    return Telling(
        words,
        lambda trial: (
            f"{words[0]} and {words[1]} predict positions that differ by chi2 = {trial.gain:.3g} under these controls",
            True,
        ),
    )


def _beyond(fit: Fit, other: Fit) -> str:
    """What a set has beyond another one, in names, with places where the other one has the name elsewhere."""
    there = {name for name, _ in other.keys - fit.keys}
    words = [f"{name} at {target}" if name in there else name for name, target in sorted(fit.keys - other.keys)]
    return " + ".join(words) or ("what both share" if fit.effects else "no effect")


def _apart(
    engine: Engine, segments: Segments, starts: Array, both: list[Candidate], noise: NoiseModel, reach: Array
) -> tuple[Array, Array]:
    """By how much chi2 two models differ in each trial, 0 where a simulation fails; and how far they go astray.

    Args:
        engine: simulates.
        segments: S trials.
        starts: initial states of both, ``(2, S, n)``.
        both: the models.
        noise: of the recordings.
        reach: least and largest positions that are near, ``(2, C)``.

    Returns:
        ``(S,)``, and ``(S, C)`` beyond what is near, m or rad: 0 where all is near, infinite where a simulation fails.
    """
    predicted = engine.predict(segments, starts, both)
    one, other = predicted
    beyond = np.maximum(predicted - reach[1], reach[0] - predicted)
    away = np.maximum(np.nan_to_num(beyond, nan=np.inf).max(axis=(0, 2)), 0.0)
    white = (one - other) / noise.scale if noise.process is None else noise.whiten(segments, one - other)
    return np.nan_to_num((white.reshape(segments.size, -1) ** 2).sum(axis=1), posinf=0.0), away


def _reach(engine: Engine, runs: tuple[Run, ...]) -> Array:
    """Least and largest positions near those seen, by half their range, and within the joints' limits, ``(2, C)``."""
    model, joints = engine.model, [engine.model.dof_jntid[dof] for dof in engine.channels.dof]
    seen = np.concatenate([run.smooth for run in runs])
    ends = np.stack([seen.min(axis=0), seen.max(axis=0)])
    near = ends + _NEAR * np.ptp(ends, axis=0) * np.array([[-1.0], [1.0]])
    limits = np.where(model.jnt_limited[joints], model.jnt_range[joints].T, [[-np.inf], [np.inf]])
    return np.stack([np.maximum(near[0], limits[0]), np.minimum(near[1], limits[1])])


def _limits(engine: Engine, runs: tuple[Run, ...]) -> tuple[Array, Array, Array]:
    """Least, mean and largest control, ``(nu,)`` each: as seen, and within the limits; these where none was seen."""
    seen, ends = np.concatenate([run.control for run in runs]), engine.limits
    low, high = seen.min(axis=0), seen.max(axis=0)
    unused = (low == high) & np.isfinite(ends).all(axis=0)
    low, high = (
        np.where(unused, ends[0], np.maximum(low, ends[0])),
        np.where(unused, ends[1], np.minimum(high, ends[1])),
    )
    return low, np.clip(seen.mean(axis=0), low, high), high


def _multisine(rng: np.random.Generator, time: Array, low: Array, middle: Array, high: Array) -> Array:
    frequency = rng.uniform(0.1, 3.0, (4, len(low)))
    phase = rng.uniform(0, 2 * np.pi, (4, len(low)))
    weight = rng.dirichlet(np.ones(4), len(low)).T
    waves = (weight * np.sin(2 * np.pi * frequency * time[:-1, None, None] + phase)).sum(axis=1)
    return np.asarray(middle + np.where(waves > 0.0, high - middle, middle - low) * waves * rng.uniform(0.1, 1.0))


def _csv(engine: Engine, time: Array, control: Array) -> str:
    out = io.StringIO()
    inputs = input_addresses(engine.model)
    table = np.column_stack([time, np.vstack([control, control[-1:]])[:, list(inputs.values())]])
    header = ",".join(["time", *(f"ctrl.{name}" for name in inputs)])
    np.savetxt(out, table, delimiter=",", header=header, comments="", fmt="%.9g")
    return out.getvalue()
