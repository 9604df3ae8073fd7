"""How well models predict runs: one step ahead of what they have seen, and freely from a fitted initial state."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array, Run, median_step
from torch_activegp.diagnosis.inputs.segments import Segments, cut, lay
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

STEP = 0.1
"""One step ahead means at least this long, s: in one sample a machine hardly moves by more than the noise."""
SEEN = 0.4
"""Each model has its state from what was recorded so long before, s. States smoothed without a model are too rough to
step from: their velocities make errors several times the noise, behind which no correction shows."""
_SEEN_ROWS = 6
_BRIEFLY = 0.02
"""Along a line through the first six rows at least, and so much of a run, s, a guess of its initial state leads: by
time stamps that are 0.1 ms off a motor at 127 rad/s began at 27 rad/s in the smoothed recording, and no fit found
back. With the right friction its free run was 2.7 of the motion away, for 0.08."""
_EVERY = 0.5
PAD = 0.1
"""At the beginning of each run it is simulated and counts for nothing, s: what a delay remembers is not recorded."""
_FIRST = 1.0
_ROUNDS = 5
_ROUGHLY = (0.005, 0.00125)
"""Time steps in which initial states are fitted, s: the first that tell what the engine does."""
_LOST = 4.0
"""A model whose chi2 per sample is larger on a run does not follow it."""
_STILL = 3.0
"""A joint that moves by less than so many times its noise in a run stands still there."""
FAILED = 1e9
"""The error of a simulation that fails, in standard deviations as all errors are."""
_ALIKE = 0.2
"""Part of a chi2, and of the number of samples, by which it may differ in shorter steps."""


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
    begin = _Beginnings(engine, noise, candidates, median_step(runs))
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
        seen = min(max(round(SEEN / step), _SEEN_ROWS), rows - ahead - pad)
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
    was met first.

    Returns:
        For each candidate and each run, positions ``(K + 1, C)``, rad or m, and the initial state, ``(nq + nv,)``.
    """
    whole = cut(runs, 1e9, PAD)
    begin = _Beginnings(engine, noise, candidates, median_step(runs))
    starts, chi2 = _followed(begin, runs, [_FIRST])
    lost = np.flatnonzero((chi2 > _LOST * whole.samples).any(axis=1))
    doublings = math.ceil(math.log2(max(max(float(run.time[-1]) for run in runs) / _FIRST, 1.0)))
    lengths = [_FIRST * 2.0**n for n in range(1, doublings)]  # the whole comes in the end
    if lost.size and lengths:
        others, other = _followed(begin.of(lost), runs, lengths)
        starts[lost] = np.where((other < chi2[lost])[..., None], others, starts[lost])
    predicted = engine.predict(whole, starts, candidates)
    return [
        [(path[i, : len(run)], begin[i]) for i, run in enumerate(runs)]
        for path, begin in zip(predicted, starts, strict=True)
    ]


class _Beginnings:
    """Initial states that fit each of some candidates best.

    They are fitted in long steps, where these tell from there what the engine itself does. Steps that misled about a
    candidate once are not tried with it again: a longer run wants no longer ones.

    Args:
        engine: simulates.
        noise: whitens.
        candidates: N models.
        interval: between rows, s.
        first: number of the form that is tried first, by candidate.
    """

    def __init__(
        self,
        engine: Engine,
        noise: NoiseModel,
        candidates: Sequence[Candidate],
        interval: float,
        first: NDArray[np.int64] | None = None,
    ) -> None:
        self.engine, self.noise, self.candidates, self._interval = engine, noise, list(candidates), interval
        longer = [engine.in_longer_steps(seconds, interval) for seconds in _ROUGHLY]
        self._forms = list({form.substeps: form for form in (*longer, engine)}.values())  # of the same the last: itself
        self._first = np.zeros(len(self.candidates), dtype=np.int64) if first is None else first

    def of(self, which: NDArray[np.int64]) -> _Beginnings:
        """The same for some of the candidates."""
        some = [self.candidates[int(i)] for i in which]
        return _Beginnings(self.engine, self.noise, some, self._interval, self._first[which])

    def guess(self, segments: Segments) -> Array:
        """First guesses ``(N, S, nq + nv)``: the smoothed recording or lines, whichever leads on better."""
        smooth, count = self.engine.starts(segments), len(self.candidates)
        both = [np.stack([some] * count) for some in (smooth, _along_lines(self.engine, segments, smooth))]
        return _better(Shooting(self.engine, segments, self.noise), self.candidates, *both)

    def fit(self, segments: Segments, starts: Array) -> Array:
        """Initial states ``(N, S, nq + nv)``, from first guesses, one for all candidates or one for each."""
        sets = [(candidate.effects, candidate.values) for candidate in self.candidates]
        found = np.broadcast_to(starts, (len(sets), *starts.shape[-2:])).copy()
        given = found.copy()
        for number, form in enumerate(self._forms):
            which = np.flatnonzero(self._first == number)
            if not len(which):
                continue
            fits = Shooting(form, segments, self.noise).fit([sets[i] for i in which], given[which], _ROUNDS, hold=True)
            found[which] = [fit.starts for fit in fits]
            if form is not self.engine:
                self._first[which] += ~_agrees(Shooting(self.engine, segments, self.noise), fits)
        return found


def _agrees(shooting: Shooting, fits: Sequence[Fit]) -> NDArray[np.bool_]:
    """Whether a likelihood sees fits that were made with other time steps as those did, ``(N,)``."""
    states = np.stack([fit.starts for fit in fits])
    predicted = shooting.engine.predict(shooting.segments, states, [fit.candidate for fit in fits])
    chi2 = (shooting.residuals(predicted) ** 2).sum(axis=-1)
    told = np.stack([fit.per_segment for fit in fits])
    return np.asarray((np.abs(chi2 - told) < _ALIKE * (told + shooting.segments.samples)).all(axis=-1))


def _followed(begin: _Beginnings, runs: Sequence[Run], lengths: Sequence[float]) -> tuple[Array, Array]:
    """Initial states ``(N, S, nq + nv)`` that fit whole runs, and chi2 ``(N, S)``.

    Args:
        begin: fits the states of N models.
        runs: S whole runs.
        lengths: of the beginnings to which states are fitted first, s, in turn.
    """
    whole = cut(runs, 1e9, PAD)
    shooting = Shooting(begin.engine, whole, begin.noise)
    pieces = [cut(runs, length, PAD) for length in lengths]
    beginnings = [some.pick(np.flatnonzero(some.first == 0)) for some in pieces]
    starts = begin.guess(beginnings[0])
    for heads in beginnings:
        starts = _better(shooting, begin.candidates, begin.fit(heads, starts), starts)
    ended = begin.fit(whole, starts)
    return ended, _chi2(shooting, begin.candidates, ended)


def _along_lines(engine: Engine, segments: Segments, smooth: Array) -> Array:
    """Initial states ``(S, nq + nv)`` with the recorded joints where lines through their first rows put them."""
    states, channels = smooth.copy(), engine.channels
    clock = np.cumsum(np.pad(segments.dt, ((0, 0), (1, 0))), axis=1)
    for s, time in enumerate(clock):
        run = segments.runs[segments.run[s]]
        seen = np.flatnonzero(segments.counts[s]).max(initial=0) + 1  # and of the run before, what is not scored
        rows = np.flatnonzero(run.counted[segments.first[s] :][:seen])
        rows = rows[: max(int(np.searchsorted(time[rows], _BRIEFLY)), _SEEN_ROWS)]
        if len(rows) > 1:
            slope, value = np.polyfit(time[rows], segments.position[s, rows], 1)
            states[s, channels.qpos], states[s, engine.model.nq + np.asarray(channels.dof)] = value, slope
    return states


def _better(shooting: Shooting, candidates: Sequence[Candidate], one: Array, other: Array) -> Array:
    """Of two initial states ``(N, S, nq + nv)`` those from which a candidate follows a run better."""
    chi2 = _chi2(shooting, [*candidates, *candidates], np.concatenate([one, other]))
    ahead = chi2[: len(one)] <= chi2[len(one) :]
    return np.where(ahead[..., None], one, other)


def _chi2(shooting: Shooting, candidates: Sequence[Candidate], states: Array) -> Array:
    """Chi2 of candidates from their initial states, ``(N, S)``; infinite where a simulation fails."""
    predicted = shooting.engine.predict(shooting.segments, states, candidates)
    return np.nan_to_num((shooting.residuals(predicted) ** 2).sum(axis=-1), nan=np.inf)


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
        The ``holdout`` entry of ``diagnosis.json``, and traces as the report draws them. A joint that stands still in a
        run counts in nothing over all, unless all do in all runs, and its own errors are in units of its noise; those
        of a simulation that fails are 1e9.
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
    begins = cut(runs, 1e9, PAD).scored[:, 0]
    for number, run in enumerate(runs):
        spread = run.position[run.counted].std(axis=0)
        scored = run.counted & (np.arange(len(run)) >= begins[number])
        still = spread < _STILL * noise.scale
        spread = np.where(still, noise.scale, spread)
        frees = {name: some[number] for name, some in free.items()}
        for c, joint in enumerate(joints):
            entry: dict[str, Any] = {"run": run.label, "channel": f"qpos.{joint}", "one_step": {}, "free_run": {}}
            for name in models:
                far = run.position[scored, c] - frees[name][0][scored, c]
                entry["one_step"][name] = rms(ahead[name][number][:, c] / spread[c])
                entry["free_run"][name] = rms(far / spread[c])
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
