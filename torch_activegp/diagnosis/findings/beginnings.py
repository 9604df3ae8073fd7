"""Initial states from which models follow a recording best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.point import chi2_of
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

SEEN_ROWS = 6
_BRIEFLY = 0.02
"""Along a line through the first six rows at least, and so much of a run, s, a guess of its initial state leads: by
time stamps that are 0.1 ms off a motor at 127 rad/s began at 27 rad/s in the smoothed recording, and no fit found
back. With the right friction its free run was 2.7 of the motion away, for 0.08."""
_ROUNDS = 5
_ROUGHLY = (0.005, 0.00125)
"""Time steps in which initial states are fitted, s: the first that tell what the engine does. The last of them tell
which of two is better: forecasts of a joint that sticks firmly took 30 of 72 s, half of that for guesses in 0.25 ms."""
_ALIKE = 0.2
"""Part of a chi2, and of the number of samples, by which it may differ in shorter steps."""


class Beginnings:
    """Initial states that fit each of some candidates best.

    They are fitted in long steps, where these tell from there what the engine itself does. Steps that misled about a
    candidate once are not tried with it again: a longer run wants no longer ones.

    Args:
        engine: simulates.
        noise: whitens, without an acceleration: all of a free run is to tell where it began.
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
        self.engine, self.noise = engine, noise.of_positions
        self.candidates, self._interval = list(candidates), interval
        longer = [engine.in_longer_steps(seconds, interval) for seconds in _ROUGHLY]
        self._forms = list({form.substeps: form for form in (*longer, engine)}.values())  # of the same the last: itself
        self._compared = [form.substeps for form in self._forms].index(longer[-1].substeps)
        self._first = np.zeros(len(self.candidates), dtype=np.int64) if first is None else first

    def of(self, which: NDArray[np.int64]) -> Beginnings:
        """The same for some of the candidates."""
        some = [self.candidates[int(i)] for i in which]
        return Beginnings(self.engine, self.noise, some, self._interval, self._first[which])

    def guess(self, segments: Segments) -> Array:
        """First guesses ``(N, S, nq + nv)``: the smoothed recording or lines, whichever leads on better."""
        smooth, count = self.engine.starts(segments), len(self.candidates)
        both = [np.stack([some] * count) for some in (smooth, along_lines(self.engine, segments, smooth))]
        return self.better(segments, *both)

    def better(self, segments: Segments, one: Array, other: Array) -> Array:
        """Of two initial states ``(N, S, nq + nv)`` those from which a candidate follows a segment better."""
        asked, chi2 = np.maximum(self._first, self._compared), np.empty((2, *one.shape[:2]))
        for number, form in enumerate(self._forms):
            which = np.flatnonzero(asked == number)
            if not len(which):
                continue
            states, shooting = np.concatenate([one[which], other[which]]), Shooting(form, segments, self.noise)
            paths = form.predict(segments, states, [self.candidates[i] for i in which] * 2)
            chi2[:, which] = left_by(shooting, paths).reshape(2, len(which), -1)
            fails = ~np.isfinite(chi2[:, which]).all(axis=(0, 2))
            asked[which[fails]] = len(self._forms) - 1  # what flies apart in so long steps may not in the engine's
        return np.where((chi2[0] <= chi2[1])[..., None], one, other)

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


def along_lines(engine: Engine, segments: Segments, smooth: Array) -> Array:
    """Initial states ``(S, nq + nv)`` with the recorded joints where lines through their first rows put them."""
    states, channels = smooth.copy(), engine.channels
    clock = np.cumsum(np.pad(segments.dt, ((0, 0), (1, 0))), axis=1)
    for s, time in enumerate(clock):
        run = segments.runs[segments.run[s]]
        seen = np.flatnonzero(segments.counts[s]).max(initial=0) + 1  # and of the run before, what is not scored
        rows = np.flatnonzero(run.counted[segments.first[s] :][:seen])
        rows = rows[: max(int(np.searchsorted(time[rows], _BRIEFLY)), SEEN_ROWS)]
        if len(rows) > 1:
            slope, value = np.polyfit(time[rows], segments.position[s, rows], 1)
            states[s, channels.qpos], states[s, engine.model.nq + np.asarray(channels.dof)] = value, slope
    return states


def left_by(shooting: Shooting, predicted: Array) -> Array:
    """Chi2 of predictions ``(N, S, K + 1, C)`` for each segment, ``(N, S)``; infinite where a simulation failed."""
    return chi2_of(shooting.residuals(predicted), failed=np.inf)


def _agrees(shooting: Shooting, fits: Sequence[Fit]) -> NDArray[np.bool_]:
    """Whether a likelihood sees fits that were made with other time steps as those did, ``(N,)``."""
    states = np.stack([fit.starts for fit in fits])
    chi2 = left_by(shooting, shooting.engine.predict(shooting.segments, states, [fit.candidate for fit in fits]))
    told = np.stack([fit.per_segment for fit in fits])
    return np.asarray((np.abs(chi2 - told) < _ALIKE * (told + shooting.segments.samples)).all(axis=-1))
