"""How well models predict runs: one step ahead of what they have seen, and freely from a fitted initial state."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.findings.beginnings import SEEN_ROWS, Beginnings, left_by
from torch_activegp.diagnosis.inputs.held_out import PAD, SEEN, STEP
from torch_activegp.diagnosis.inputs.runs import Array, Run, median_step
from torch_activegp.diagnosis.inputs.segments import Segments, cut, lay
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

_EVERY = 0.5
_FIRST = 1.0
_LOST = 4.0
"""A model whose chi2 per sample is larger on a run does not follow it."""
_NEARER = 0.99
"""Part of a chi2 that other initial states must leave at most, for fits end within a percent of each other."""
_STILL = 3.0
"""A joint that moves by less than so many times its noise in a run stands still there."""
FAILED = 1e9
"""The error of a simulation that fails, in standard deviations as all errors are."""


def one_step(
    engine: Engine, candidates: Sequence[Candidate], runs: Sequence[Run], noise: NoiseModel
) -> list[list[Array]]:
    """Errors one step after what each model was shown, its initial state fitted to that.

    Returns:
        For each candidate and each run, ``(N, C)``, rad or m; N steps, one every half a second.
    """
    windows, ends = _windows(runs)
    each = np.arange(windows.size)
    before = np.arange(windows.intervals + 1) <= ends[:, :1]
    seen = dataclasses.replace(windows, counts=windows.counts & before)
    begin = Beginnings(engine, noise, candidates, median_step(runs))
    starts = begin.fit(seen, begin.guess(seen))
    predicted = engine.predict(windows, starts, candidates)
    errors = windows.position[each, ends[:, 1]] - predicted[:, each, ends[:, 1]]
    rows = windows.first + ends[:, 1]
    own = [windows.run == number for number in range(len(runs))]
    there = [which & run.counted[np.minimum(rows, len(run) - 1)] for which, run in zip(own, runs, strict=True)]
    chosen = [known if known.any() else which for known, which in zip(there, own, strict=True)]
    return [[some[which] for which in chosen] for some in errors]


def _windows(runs: Sequence[Run]) -> tuple[Segments, NDArray[np.int64]]:
    """Pieces of runs, and in each the last row that is seen and the row one step later, ``(S, 2)``."""
    pieces: list[tuple[int, int, int, int]] = []
    ends = []
    for number, run in enumerate(runs):
        rows, step = len(run) - 1, float(np.median(run.dt))
        ahead = min(max(round(STEP / step), 1), rows)
        pad = min(math.ceil(PAD / step), (rows - ahead) // 2)
        seen = min(max(round(SEEN / step), SEEN_ROWS), rows - ahead - pad)
        last = pad + seen + ahead
        for first in range(0, rows - last + 1, max(round(_EVERY / step), 1)):
            pieces.append((number, first, first + pad, first + last))
            ends.append((pad + seen, last))
    return lay(runs, pieces), np.array(ends, dtype=np.int64)


def free_run(
    engine: Engine, candidates: Sequence[Candidate], runs: Sequence[Run], noise: NoiseModel
) -> list[list[tuple[Array, Array]]]:
    """Positions of whole runs, each from one fitted initial state.

    The fit begins where one to the first second ends, or with the smoothed recording or a line through its first rows,
    whichever leads on better. Of a model that does not follow a run so, initial states are fitted to ever longer
    beginnings too: a wrong model has several that fit it almost as well, and its error would be that of the one that
    was met first. And in runs that another of the models follows they begin where that begins: on the way to its right
    state a leg met a stop that it did not reach in the run, and was 12 times the noise away, for 0.9 without the stop.

    Returns:
        For each candidate and each run, positions ``(K + 1, C)``, rad or m, and the initial state, ``(nq + nv,)``.
    """
    whole = whole_runs(runs)
    begin = Beginnings(engine, noise, candidates, median_step(runs))
    shooting = Shooting(engine, whole, begin.noise)
    starts, paths = _followed(begin, whole, [_FIRST])
    left, most = left_by(shooting, paths), _LOST * whole.samples

    def keep(which: NDArray[np.int64], rows: NDArray[np.int64], others: Array, there: Array) -> None:
        """Takes initial states of some models in some runs, and paths from there, where these are clearly nearer."""
        at, now = np.ix_(which, rows), left_by(shooting.pick(rows), there)
        nearer = now < _NEARER * left[at]
        left[at] = np.where(nearer, now, left[at])
        starts[at] = np.where(nearer[..., None], others, starts[at])
        paths[at] = np.where(nearer[..., None, None], there, paths[at])

    lost = np.flatnonzero((left > most).any(axis=1))
    doublings = math.ceil(math.log2(max(max(float(run.time[-1]) for run in runs) / _FIRST, 1.0)))
    lengths = [_FIRST * 2.0**n for n in range(1, doublings)]  # the whole comes in the end
    if lost.size and lengths:
        keep(lost, np.arange(len(runs)), *_followed(begin.of(lost), whole, lengths))
    astray = (left > most) & (left.min(axis=0) <= most)
    lost, rows = np.flatnonzero(astray.any(axis=1)), np.flatnonzero(astray.any(axis=0))
    if lost.size:
        nearest = starts[left[:, rows].argmin(axis=0), rows]
        keep(lost, rows, *_ended(begin.of(lost), whole.pick(rows), nearest))
    return [
        [(path[i, : len(run)], first[i]) for i, run in enumerate(runs)]
        for path, first in zip(paths, starts, strict=True)
    ]


def _followed(begin: Beginnings, whole: Segments, lengths: Sequence[float]) -> tuple[Array, Array]:
    """Initial states ``(N, S, nq + nv)`` that fit whole runs, and the positions from there, ``(N, S, K + 1, C)``.

    Args:
        begin: fits the states of N models.
        whole: the S runs, each in one piece.
        lengths: of the beginnings to which states are fitted first, s, in turn.
    """
    pieces = [cut(whole.runs, length, PAD) for length in lengths]
    beginnings = [some.pick(np.flatnonzero(some.first == 0)) for some in pieces]
    starts = begin.guess(beginnings[0])
    for heads in beginnings:
        starts = begin.better(whole, begin.fit(heads, starts), starts)
    return _ended(begin, whole, starts)


def _ended(begin: Beginnings, whole: Segments, starts: Array) -> tuple[Array, Array]:
    """As :func:`_followed`, from first guesses for whole runs, one for all models or one for each."""
    ended = begin.fit(whole, starts)
    return ended, begin.engine.predict(whole, ended, begin.candidates)


def compare(
    models: dict[str, tuple[Engine, Candidate]], runs: Sequence[Run], joints: Sequence[str], noise: NoiseModel
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """NRMSE of several models on runs, per run and channel and over all, and the traces of the free runs.

    Args:
        models: engine and candidate by the name of the model (``before``, ``after``, ``gp``).
        runs: held-out runs.
        joints: the recorded joints.
        noise: noise of the recordings.

    Returns:
        The ``holdout`` entry of ``diagnosis.json``, and traces as the report draws them. Models by one engine lend each
        other initial states, :func:`free_run`, so that one may follow a run better than alone. A joint that stands
        still in a run counts in nothing over all, unless all do in all runs, and its own errors are in units of its
        noise; those of a simulation that fails are 1e9.
    """
    entries: list[dict[str, Any]] = []
    traces: list[dict[str, Any]] = []
    counted: list[bool] = []
    units = next(iter(models.values()))[0].channels.units
    free: dict[str, list[tuple[Array, Array]]] = {}
    ahead: dict[str, list[Array]] = {}
    for engine in dict.fromkeys(engine for engine, _ in models.values()):  # side by side where one engine has several
        some = {name: candidate for name, (own, candidate) in models.items() if own is engine}
        different = {id(candidate): candidate for candidate in some.values()}
        paths = dict(zip(different, free_run(engine, [*different.values()], runs, noise), strict=True))
        steps = dict(zip(different, one_step(engine, [*different.values()], runs, noise), strict=True))
        free |= {name: paths[id(candidate)] for name, candidate in some.items()}
        ahead |= {name: steps[id(candidate)] for name, candidate in some.items()}
    off = [[run.position - path for run, (path, _) in zip(runs, some, strict=True)] for some in free.values()]
    far = dict(zip(free, errors_of_free_runs(runs, off, noise), strict=True))
    for number, run in enumerate(runs):
        spread, still = _units_of_errors(run, noise)
        frees = {name: some[number] for name, some in free.items()}
        for c, joint in enumerate(joints):
            entry: dict[str, Any] = {"run": run.label, "channel": f"qpos.{joint}", "one_step": {}, "free_run": {}}
            for name in models:
                entry["one_step"][name] = rms(ahead[name][number][:, c] / spread[c])
                entry["free_run"][name] = float(far[name][number, c])
            for kind in ("one_step", "free_run"):
                entry[kind]["noise"] = float(noise.scale[c] / spread[c])
            entries.append(entry)
            counted.append(not still[c])
            traces.append(_trace(run, c, f"qpos.{joint}", units[c], frees, float(noise.scale[c])))
    counting = [entry for entry, counts in zip(entries, counted, strict=True) if counts] or entries
    overall: dict[str, Any] = {
        kind: {name: rms(np.array([entry[kind][name] for entry in counting])) for name in (*models, "noise")}
        for kind in ("one_step", "free_run")
    }
    overall["runs"] = entries
    overall["step_seconds"] = STEP
    return overall, traces


def without_model(
    name: str, holdout: Mapping[str, Any], traces: Sequence[Mapping[str, Any]]
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """What :func:`compare` returned, without one of the models."""

    def told(entry: Mapping[str, Any]) -> dict[str, Any]:
        errors = {kind: {key: v for key, v in entry[kind].items() if key != name} for kind in ("one_step", "free_run")}
        return {**entry, **errors}

    drawn = [{key: v for key, v in trace.items() if key != f"start_{name}"} | {name: None} for trace in traces]
    return {**told(holdout), "runs": [told(entry) for entry in holdout["runs"]]}, drawn


def errors_of_free_runs(runs: Sequence[Run], off: Sequence[Sequence[Array]], noise: NoiseModel) -> Array:
    """NRMSE of the free runs of N models, ``(N, R, C)``, joint by joint.

    Args:
        runs: R runs.
        off: of each model and each run, how far its positions are off, ``(K + 1, C)``.
        noise: of the recordings.
    """
    errors = np.empty((len(off), len(runs), len(noise.scale)))
    for number, (run, begin) in enumerate(zip(runs, whole_runs(runs).scored[:, 0], strict=True)):
        scored = run.counted & (np.arange(len(run)) >= begin)
        unit, _ = _units_of_errors(run, noise)
        for own, some in zip(errors, off, strict=True):
            own[number] = [rms(joint) for joint in (some[number][scored] / unit).T]
    return errors


def whole_runs(runs: Sequence[Run]) -> Segments:
    """Runs, each in one piece."""
    return cut(runs, 1e9, PAD)


def _units_of_errors(run: Run, noise: NoiseModel) -> tuple[Array, NDArray[np.bool_]]:
    """What the errors of a run are told in, joint by joint, ``(C,)``, and which joints stand still, ``(C,)``.

    The standard deviation of what was recorded, of a joint that stands still its noise.
    """
    spread = run.position[run.counted].std(axis=0)
    still = spread < _STILL * noise.scale
    return np.where(still, noise.scale, spread), still


def rms(values: Array) -> float:
    """Root mean square of errors, at most :data:`FAILED`."""
    value = float(np.sqrt(np.mean(values**2)))
    return min(value, FAILED) if np.isfinite(value) else FAILED


def _trace(
    run: Run, channel: int, name: str, unit: str, frees: dict[str, tuple[Array, Array]], noise: float
) -> dict[str, Any]:
    thin = max(len(run) // 1500, 1)
    trace: dict[str, Any] = {"run": run.label, "channel": name, "unit": unit, "noise": noise, "gp": None}
    trace["time"] = run.time[::thin].round(6).tolist()
    trace["measured"] = run.position[::thin, channel].round(7).tolist()
    for kind, (positions, state) in frees.items():
        drawn = positions[::thin, channel].round(7).tolist()
        trace[kind] = [value if np.isfinite(value) else None for value in drawn]
        trace[f"start_{kind}"] = state.tolist()
    return trace
