"""Runs cut into segments of equal length, each with its own initial state."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array, Run

_LEAST, _LEAST_COUNTED = 12, 6
"""Intervals in a segment that another one was cut into, and recorded rows."""
_FAR_OFF = 30.0
_A_CALL, _WORTH_A_CALL = 32, 0.9
"""Simulations that take as long as what a time step of many costs besides; and the part of the time that is left where
segments of different lengths are simulated apart."""


@dataclasses.dataclass(frozen=True)
class Segments:
    """S segments of K intervals side by side.

    Args:
        runs: the runs that they are cut from.
        run: which run, ``(S,)``.
        first: the row at which each simulation starts, ``(S,)``.
        position: recorded positions ``(S, K + 1, C)``.
        counts: whether a recorded position enters the likelihood, ``(S, K + 1)``: not before the first scored row, not
            where no row was recorded, not past the end of a run.
        dt: ``(S, K)``, s.
        scored: first scored row and the row at the end, ``(S, 2)``.
    """

    runs: tuple[Run, ...]
    run: NDArray[np.int64]
    first: NDArray[np.int64]
    position: Array
    counts: NDArray[np.bool_]
    dt: Array
    scored: NDArray[np.int64]

    @property
    def size(self) -> int:
        """Number of segments S."""
        return len(self.run)

    @property
    def intervals(self) -> int:
        """Number of intervals K."""
        return self.dt.shape[1]

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Intervals up to the end of each segment, ``(S,)``; what comes after is not looked at."""
        return np.asarray(self.scored[:, 1] - self.first)

    def of_like_length(self, times: int = 1) -> list[NDArray[np.int64]]:
        """Which segments to simulate together, so many times each: short ones beside long ones would wait for them."""
        order = np.argsort(-self.lengths, kind="stable")
        return [np.sort(part) for part in _parted(order, self.lengths[order], times)]

    def take(self, name: str) -> Array:
        """A column of the runs in every segment.

        Args:
            name: ``position``, ``smooth`` or ``velocity``, which give ``(S, K + 1, C)``; ``control``, which gives
                ``(S, K, nu)``; or ``force``, ``(S, K, nv)``.
        """
        columns = [getattr(run, name) for run in self.runs]
        length = max(map(len, columns))
        padded = np.stack([np.pad(c, ((0, length - len(c)), (0, 0)), mode="edge") for c in columns])
        rows = self.intervals + (1 if name in ("position", "smooth", "velocity") else 0)
        last = np.array([len(c) - 1 for c in columns])[self.run]
        index = np.minimum(self.first[:, None] + np.arange(rows), last[:, None])
        return padded[self.run[:, None], index]

    def pick(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> Segments:
        """Some of the segments."""
        names = ("run", "first", "position", "counts", "dt", "scored")
        return dataclasses.replace(self, **{name: getattr(self, name)[which] for name in names})

    def spread(self, count: int) -> NDArray[np.int64]:
        """The numbers of so many of them, or of all where there are fewer, evenly spread."""
        return np.unique(np.linspace(0, self.size - 1, count).astype(np.int64))

    def until(self, intervals: int) -> Segments:
        """Their first intervals, so many of them."""
        rows = {name: getattr(self, name)[:, : intervals + 1] for name in ("position", "counts")}
        return dataclasses.replace(self, dt=self.dt[:, :intervals], **rows)

    @property
    def samples(self) -> NDArray[np.int64]:
        """Recorded positions that count in each segment, ``(S,)``, at least 1."""
        return np.asarray(np.maximum(self.counts.sum(axis=1) * self.position.shape[-1], 1))

    def far_off(self, per_segment: Array, much: float = _FAR_OFF) -> NDArray[np.bool_]:
        """Where a fit says little about where the machine was, ``(S,)``.

        Args:
            per_segment: chi2 of the segments, ``(S,)``.
            much: chi2 of a sample beyond which it is far off.
        """
        return np.asarray(per_segment > much * self.samples)

    @property
    def usual_seconds(self) -> float:
        """How long the scored part of a segment usually is, s."""
        return float(np.median(np.diff(self.scored, axis=1)) * np.median(self.dt))

    def centers(self) -> Array:
        """The time at the middle of the scored part of each segment, ``(S,)``, s."""
        return np.array([self.runs[r].time[ends].mean() for r, ends in zip(self.run, self.scored, strict=True)])


def cut(runs: Sequence[Run], seconds: float, pad: float) -> Segments:
    """Cuts runs into segments of about equal length.

    Args:
        runs: the runs.
        seconds: length of the scored part of a segment; each run is divided evenly.
        pad: how long each simulation runs before its scored part, s, so that a sensor's delay has a past and the
            unknown past of a control fades. The first ``pad`` of each run is simulated and not scored.
    """
    pieces: list[tuple[int, int, int, int]] = []
    for number, run in enumerate(runs):
        rows = len(run) - 1
        step = float(np.median(run.dt))
        before = min(int(np.ceil(pad / step)), rows // 6)
        scored = rows - before
        count = min(max(round(scored * step / seconds), 1), scored)
        edges = np.linspace(before, rows, count + 1).round().astype(int)
        pieces += [(number, a - before, a, b) for a, b in itertools.pairwise(edges.tolist())]
    return lay(runs, pieces)


def halve(segments: Segments, which: NDArray[np.bool_], share: float | Array = 0.5) -> Segments:
    """Cuts some segments in two where they are long enough; the rest stay as they are.

    Args:
        segments: S segments.
        which: those to cut, ``(S,)``.
        share: how much of a segment its first piece is; one for all, or ``(S,)``.
    """
    pieces: list[tuple[int, int, int, int]] = []
    shares = np.broadcast_to(share, which.shape)
    rows = zip(segments.run, segments.first, segments.scored, which, shares, strict=True)
    for number, first, (a, b), cut_it, part in rows:
        middle, counted = a + int(part * (b - a)), segments.runs[number].counted
        enough = min(middle - a, b - middle) >= _LEAST
        enough &= min(counted[a:middle].sum(), counted[middle:b].sum()) >= _LEAST_COUNTED
        parts = [(a, middle), (middle, b)] if cut_it and enough else [(a, b)]
        pieces += [(int(number), int(c - (a - first)), int(c), int(d)) for c, d in parts]
    return lay(segments.runs, pieces)


def lay(runs: Sequence[Run], pieces: Sequence[tuple[int, int, int, int]]) -> Segments:
    """Segments from run, first simulated row, first scored row and row at the end."""
    length = max(b - start for _, start, _, b in pieces)
    channels = runs[0].position.shape[1]
    position = np.zeros((len(pieces), length + 1, channels))
    counts = np.zeros((len(pieces), length + 1), dtype=bool)
    dt = np.zeros((len(pieces), length))
    for s, (number, start, a, b) in enumerate(pieces):
        run = runs[number]
        position[s, : b + 1 - start] = run.position[start : b + 1]
        position[s, b + 1 - start :] = run.position[b]
        # the last row of a segment is the first of the next one; it counts once
        last = b + 1 if b == len(run) - 1 else b
        counts[s, a - start : last - start] = run.counted[a:last]
        dt[s, : b - start] = run.dt[start:b]
        dt[s, b - start :] = run.dt[b - 1]
    table = np.array(pieces, dtype=np.int64)
    return Segments(tuple(runs), table[:, 0], table[:, 1], position, counts, dt, table[:, 2:])


def _parted(order: NDArray[np.int64], lengths: NDArray[np.int64], times: int) -> list[NDArray[np.int64]]:
    """Parts of segments by descending lengths, each of which is simulated for as long as its longest."""
    rest = np.arange(1, len(order))
    if not len(rest):
        return [order]
    cost = lengths[0] * (rest * times + _A_CALL) + lengths[rest] * ((len(order) - rest) * times + _A_CALL)
    cut = int(np.argmin(cost))
    if cost[cut] > _WORTH_A_CALL * lengths[0] * (len(order) * times + _A_CALL):
        return [order]
    cut = int(rest[cut])
    return [*_parted(order[:cut], lengths[:cut], times), *_parted(order[cut:], lengths[cut:], times)]
