"""Multiple shooting: every segment has a free initial state, eliminated by projection; Gauss-Newton for the rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Array
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.advance import advance
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.gauss_newton import SETTLE, Problem
from torch_activegp.diagnosis.shooting.race import Race
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Effect

ROUNDS = 60
"""Simulations of a fit at most, one after the other, many of them of a few segments; where joints stick, 30 ended
half-way."""
_SOON, _FAR_OFF = 20, 300.0
"""After so many rounds fits end that are so many times the noise away: what they lead to is not sought."""
LENDS = 3.0
"""Times the steps of a cheap engine from which on derivatives of fits come from it, and it is worth a fit."""
_COLOUR_UNSEEN = 1 / 67


@dataclasses.dataclass(frozen=True, eq=False)
class Shooting:
    """The likelihood of positions.

    Args:
        engine: simulates.
        segments: S segments.
        noise: whitens.
        offset: what is added to its positions, ``(S, K + 1, C)``; see :meth:`corrected`.
        cheap: simulates where only differences between simulations count; the engine itself where there is none.
    """

    engine: Engine
    segments: Segments
    noise: NoiseModel
    offset: Array | None = None
    cheap: Engine | None = None

    @property
    def differences(self) -> Engine:
        """The engine for differences between simulations."""
        return self.cheap or self.engine

    @property
    def lends(self) -> bool:
        """Whether derivatives of fits come from the cheap engine: where that takes a third of the steps or fewer."""
        cheap, own = (engine.steps_in(self.segments) for engine in (self.differences, self.engine))
        return LENDS * cheap <= own

    @property
    def work(self) -> float:
        """Time steps that its engines have computed, :attr:`Engine.work`."""
        return sum(engine.work for engine in {self.engine, self.differences})

    @property
    def samples(self) -> int:
        """Number of recorded positions that count."""
        return int(self.segments.counts.sum()) * self.segments.position.shape[-1]

    @property
    def dof(self) -> int:
        """Samples less the free initial states."""
        return max(self.samples - self.segments.size * 2 * len(self.engine.channels.joints), 1)

    @property
    def hides_colour(self) -> bool:
        """Whether rows are too far apart (recordings below 67 Hz) to see if an encoder filters its noise."""
        return float(np.median(self.segments.dt)) > _COLOUR_UNSEEN

    @property
    def measured(self) -> Array:
        """The recorded positions less the offset, ``(S, K + 1, C)``: what a prediction is compared with."""
        return self.segments.position if self.offset is None else self.segments.position - self.offset

    def residuals(self, predicted: Array) -> Array:
        """Whitened residuals ``(..., S, M)`` of predicted positions ``(..., S, K + 1, C)``."""
        return self.noise.whiten(self.segments, self.measured - predicted)

    def residuals_from(self, starts: Array, candidates: Sequence[Candidate]) -> Array:
        """Whitened residuals of N candidates from initial states ``(N, S, nq + nv)``, ``(N, S, M)``."""
        return self.residuals(self.engine.predict(self.segments, starts, candidates))

    def residual_of(self, fit: Fit) -> Array:
        """Whitened residuals of a fit ``(S, M)``, zero where its simulation failed."""
        return np.nan_to_num(self.residuals(self.predicted(fit)))

    def whiten_columns(self, columns: Array) -> Array:
        """Derivatives of the positions ``(S, K + 1, C, A)`` in units of white noise, ``(S, M, A)``."""
        return self.noise.whiten_columns(self.segments, columns)

    def pick(self, which: NDArray[np.int64] | NDArray[np.bool_]) -> Shooting:
        """The same likelihood over some of the segments."""
        offset = None if self.offset is None else self.offset[which]
        return dataclasses.replace(self, segments=self.segments.pick(which), offset=offset)

    def predicted(self, fit: Fit) -> Array:
        """What the sensors would read by a fit, ``(S, K + 1, C)``; NaN in segments whose simulation failed."""
        return self.engine.predict(self.segments, fit.starts[None], [fit.candidate])[0]

    def corrected(self, precise: Engine, fit: Fit, exact: Array | None = None) -> Shooting:
        """The same with the error of a coarse engine taken out, as it is at a fit.

        The error hardly depends on the parameters, so one precise simulation serves for many coarse ones.

        Args:
            precise: the engine without that error.
            fit: where it is taken.
            exact: what the precise engine predicts there, where that is known.
        """
        if precise is self.engine:
            return dataclasses.replace(self, offset=None)
        exact = dataclasses.replace(self, engine=precise).predicted(fit) if exact is None else exact
        return dataclasses.replace(self, offset=np.nan_to_num(exact - self.predicted(fit)))

    def state_columns(self, starts: Array) -> Array:
        """Perturbations of the initial states worth trying: step sizes ``(nq + nv,)``."""
        model, channels = self.engine.model, self.engine.channels
        size = np.full(self.engine.state_size, 1e-3)
        for c, (q, v) in enumerate(zip(channels.qpos, channels.dof, strict=True)):
            size[q] = max(0.5 * self.noise.scale[c], 1e-6)
            size[model.nq + v] = max(5.0 * self.noise.scale[c], 1e-5)
        return size

    def state_reach(self) -> Array:
        """How far an initial state may sensibly move: as far and as fast as the joint did, ``(nq + nv,)``."""
        model, channels = self.engine.model, self.engine.channels
        reach = np.full(self.engine.state_size, 1.0)
        runs = self.segments.runs
        for c, (q, v) in enumerate(zip(channels.qpos, channels.dof, strict=True)):
            reach[q] = max(max(float(np.ptp(run.smooth[:, c])) for run in runs), 20.0 * self.noise.scale[c])
            reach[model.nq + v] = max(max(float(np.abs(run.velocity[:, c]).max()) for run in runs), 1e-6)
        return reach

    def subset(self, share: float, first: Array | None = None) -> tuple[Shooting, NDArray[np.int64]]:
        """The same likelihood over a share of the segments, and which.

        Args:
            share: of the segments, 0 to 1; all of them from 1 on.
            first: half of them are those with the largest of these values, ``(S,)``; the others are spread evenly.
        """
        count = min(max(int(np.ceil(share * self.segments.size)), 6), self.segments.size)
        worst = np.argsort(first)[::-1][: count // 2] if first is not None else np.zeros(0, dtype=np.int64)
        rest = np.setdiff1d(np.arange(self.segments.size), worst)
        even = rest[np.linspace(0, len(rest) - 1, count - len(worst)).round().astype(np.int64)]
        which = np.union1d(worst, even)
        return self.pick(which), which

    def fit(
        self,
        sets: Sequence[tuple[Sequence[Effect], Sequence[Array]]],
        starts: Array,
        rounds: int = ROUNDS,
        race: Race | None = None,
        hold: bool = False,
        near: Fit | None = None,
        below: Fit | Sequence[Fit] | None = None,
        work: float = np.inf,
    ) -> list[Fit]:
        """Fits several sets of effects side by side.

        Args:
            sets: effects and first guesses of their parameters.
            starts: first guess of the initial states, ``(S, nq + nv)`` or one for each set.
            rounds: simulations at most, one after the other.
            hold: keep the parameters as they are and fit the initial states alone.
            race: gives up on sets that stay far behind after two steps, and before on those that would begin anew
                from `below`; all go on where there is none.
            near: a fit near by, whose derivatives save work.
            below: a fit of what the sets have in common, or one for each set of what is in it: a first guess that is
                worse than it misleads, and is left.
            work: time steps of all that was computed by then, :attr:`work`, from which on all end.
        """
        smooth = None if near is None else self.engine.starts(self.segments)
        smaller = below if isinstance(below, Sequence) else [below] * len(sets)
        begin = starts if starts.ndim == 3 else [starts] * len(sets)
        running = {
            i: Problem(self, tuple(e), tuple(v), begin[i], hold, near, smooth, smaller[i])
            for i, (e, v) in enumerate(sets)
        }
        ended: dict[int, Fit] = {}
        for number in range(rounds + 1):
            if not running:
                break
            over = number > SETTLE + 2 and self.work > work
            advance(self, running.values(), last=over or number == rounds)
            if race is not None:
                race.give_up(list(running.values()), list(ended.values()), only_misled=number < SETTLE + 2)
            if number >= _SOON:
                for problem in running.values():
                    problem.finished |= problem.has_derivatives and problem.chi2 > _FAR_OFF * self.dof
            for i in [i for i, problem in running.items() if problem.finished]:
                ended[i] = running.pop(i).result()  # and lets go of what the fit needed
        ended |= {i: problem.result() for i, problem in running.items()}
        return [ended[i] for i in range(len(sets))]
