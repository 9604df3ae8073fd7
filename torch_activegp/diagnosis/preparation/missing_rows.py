"""The controls of rows that a recording misses: held there, or on their way from one row to the next."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import MISSING, Array, Run
from torch_activegp.diagnosis.inputs.segments import Segments, lay
from torch_activegp.diagnosis.noise.floor import noise_floor
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.given_numerics import numerics_of
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine

_ROWS = 6
_SECONDS, _IF_QUIET = (0.03, 0.06, 0.12, 0.25, 0.5), 0.12
"""How far pieces reach to either side of a gap: so many rows at least, and so long, s. The briefest in which either way
agrees better, for whatever else is missing shows in longer ones, of which the last are taken where nothing else shows:
a wrong control for a row is a small jump of the speed, and on an arm of six joints at 200 Hz 3 % of lost rows told 9 in
chi2, 120 and 1600; on a reaction wheel at 125 Hz 1 % told 5 in 0.12 s, and 400 in half a second."""
_QUIET = 1.5
"""Times the noise, at which nothing else shows."""
_SEEN = 200
"""Gaps that are looked at."""
_ROUNDS = 6
_FAILED = 1e9
_BETTER = 10.0
"""Chi2 by which one way must agree better than the other: else a recording says that controls are held."""
_LEANS = 2.0
"""The same by which a run leans to one."""


def with_missing_controls(
    runs: Sequence[Run],
    others: Sequence[Run],
    engines: Sequence[Engine],
    noise: NoiseModel,
    candidate: Candidate = NOMINAL,
) -> tuple[list[Run], list[Run], list[str]]:
    """Runs whose controls go on from one row to the next where rows are missing, if the machine moved like that.

    A recorder may miss what the machine still did. Held until the next row, controls of an arm at 100 Hz of which 4 %
    of the rows were missing left 2.3 times the noise of 1 mrad; on their way to the next row, 1.1 times. A controller
    that missed the cycle itself held them.

    Args:
        runs: these say what agrees better, each for itself or all together; controls are held in missing rows.
        others: further runs of the machine, which say it for themselves at most, and to no other.
        engines: forms of its model, of which the closest counts.
        noise: of the recordings.
        candidate: effects in the model; the controls that agree better may depend on them.

    Returns:
        The runs, the further ones, and a note where controls are not held.
    """
    degree, held = _degree(runs), [*runs, *others]
    moving, count = [moved(run, degree) for run in held], len(runs)
    mine, together = _better(moving[:count], held[:count], engines, noise, candidate)
    theirs, _ = _better(moving[count:], held[count:], engines, noise, candidate, together)
    each = np.concatenate([mine, theirs])
    ways = zip(held, moving, np.where(np.abs(each) > _BETTER, each, together), strict=True)
    found = [run if better < -_BETTER else on if better > _BETTER else _doubted(run, on) for run, on, better in ways]
    pairs = zip(held, found, strict=True)
    rows = sum(int((one.control != other.control).any(axis=1).sum()) for one, other in pairs)
    if not rows:
        return found[:count], found[count:], []
    note = (
        f"{rows} rows are missing. Controls are taken as on their way from the last row before a gap to the next: the "
        "motion agrees better with that than with controls that are held."
    )
    return found[:count], found[count:], [note]


def _better(
    moving: Sequence[Run],
    held: Sequence[Run],
    engines: Sequence[Engine],
    noise: NoiseModel,
    candidate: Candidate,
    said: float | None = None,
) -> tuple[Array, float]:
    """Chi2 by which controls that go on agree better than held ones in the briefest pieces that tell.

    Longer ones are looked at for a run that leans the other way than all together.

    Args:
        moving: runs with controls that go on in missing rows.
        held: the same with held ones.
        engines: forms of the machine's model, of which the closest counts.
        noise: of the recordings.
        candidate: effects in the model.
        said: what all together are known to say; None to ask these.

    Returns:
        Of each run, ``(R,)``, and of all together.
    """
    each, together, known, loud = np.zeros(len(held)), said or 0.0, None, False
    for seconds in _SECONDS:
        if loud and seconds > _IF_QUIET:
            break
        pieces = _around_gaps(held, seconds)
        if not pieces or pieces == known:
            continue
        known, segments = pieces, [lay(some, pieces) for some in (moving, held)]
        on, still = (
            min((_left(some, form, noise, candidate) for form in engines), key=lambda left: float(left.sum()))
            for some in segments
        )
        each = np.where(np.abs(each) > _BETTER, each, still - on)
        if said is None and abs(together) <= _BETTER:
            together = float((still - on).sum())
        loud = bool(min(on.sum(), still.sum()) > np.log1p(_QUIET) * segments[0].samples.sum())
        leans = (np.abs(each) < _BETTER) & (np.sign(together) * each < -_LEANS)
        if abs(together) > _BETTER and not leans.any():
            break
    return each, together


def _doubted(held: Run, moving: Run) -> Run:
    """A run of which nothing tells whether its controls are held in gaps; it is as unsure as the two ways differ."""
    off = moving.control - held.control
    return dataclasses.replace(held, unsure=off) if off.any() else held


def as_the_machine_moved(machine: Machine, nthread: int = 0) -> Machine:
    """A machine whose controls in missing rows are those that agree better, with a note where they are not held.

    Args:
        machine: model and runs; controls are held in missing rows.
        nthread: threads of the simulations; 0 for all cores.
    """
    if not _around_gaps([*machine.fit, *machine.holdout], _SECONDS[0]):
        return machine
    numerics, noise = numerics_of(machine, nthread), noise_floor(machine.fit)
    engines = dict.fromkeys((numerics.given, numerics.fine))
    fit, holdout, notes = with_missing_controls(machine.fit, machine.holdout, [*engines], noise)
    return dataclasses.replace(machine, fit=tuple(fit), holdout=tuple(holdout), notes=(*machine.notes, *notes))


def moved(run: Run, degree: int) -> Run:
    """A run whose controls change from row to row in gaps, as far as its own clock does, along splines of a degree.

    Straight lines where there are too few rows for the degree. Splines stay within what was recorded. How unsure they
    are is told by the nearest recorded row before, as if that were missing, and grows with the length of a gap as the
    error of a spline of that degree does.
    """
    known = np.flatnonzero(run.recorded[:-1])  # the last row's control is not used
    missing, time = _in_gaps(run)
    if not missing.any() or len(known) < 2:
        return run
    path = make_interp_spline(run.time[known], run.control[known], degree if len(known) > degree else 1)
    control, unsure = run.control.copy(), np.zeros_like(run.control)
    between = path(np.minimum(time[missing], run.time[known[-1]]))
    control[missing] = np.clip(between, run.control[known].min(axis=0), run.control[known].max(axis=0))
    rows, straight, curved = _guessed(run)
    if len(rows):
        near = np.clip(np.searchsorted(rows, np.flatnonzero(missing)) - 1, 0, None)
        before = np.clip(np.searchsorted(known, np.flatnonzero(missing)) - 1, 0, len(known) - 2)
        longer = np.diff(run.time[known])[before] / (2.0 * float(np.median(np.diff(run.time[known]))))
        unsure[missing] = (straight if degree == 1 else curved)[near] * longer[:, None] ** (degree + 1)
    return dataclasses.replace(run, control=control, unsure=unsure)


def _in_gaps(run: Run) -> tuple[NDArray[np.bool_], Array]:
    """Rows but the last that its own clock misses, ``(K,)``, and when it would have recorded the control there, s."""
    rows, known = np.arange(len(run) - 1), np.flatnonzero(run.recorded)
    if len(known) < 2:
        return np.zeros(len(rows), dtype=bool), run.time[rows]
    before = np.clip(np.searchsorted(known, rows, side="right") - 1, 0, len(known) - 2)
    first, last = run.time[known[before]], run.time[known[before + 1]]
    period = float(np.median(np.diff(run.time[known])))
    # its rows as they would be spread there: those of an uneven clock come early or late
    own = (last - first) / np.maximum(np.rint((last - first) / period), 1.0)
    into = np.floor((run.time[rows] - first) / own + 1e-6) * own
    return (last - first > MISSING * period) & (into > 0.0) & ~run.recorded[:-1], first + into


def _degree(runs: Sequence[Run]) -> int:
    """The degree of the splines by which recorded controls are told best from those before and after them.

    In brief pieces of the motion nothing shows which is the right one: straight lines between the rows of a sum of
    sines up to 3 Hz agreed as well there, and left 1.8 times the noise in longer ones.
    """
    errors = np.zeros(2)
    for run in runs:
        scale = np.where(np.ptp(run.control, axis=0) > 0.0, np.ptp(run.control, axis=0), np.inf)  # held: says nothing
        errors += [float(((off / scale) ** 2).sum()) for off in _guessed(run)[1:]]
    return 3 if errors[1] < errors[0] else 1


def _guessed(run: Run) -> tuple[NDArray[np.int64], Array, Array]:
    """Recorded rows ``(n,)`` with two on either side, and how wrong lines and splines from these are, ``(n, nu)``."""
    rows = np.flatnonzero(run.recorded[:-1])
    steps, u = np.diff(run.time[rows]), run.control[rows]
    usual, count = MISSING * float(np.median(steps)) if len(steps) else 0.0, max(len(steps) - 3, 0)
    there = np.flatnonzero(np.all([steps[k : k + count] < usual for k in range(4)], axis=0))
    lower, low, here, high, higher = (u[there + k] for k in range(5))
    return rows[there + 2], (low + high) / 2 - here, (4.0 * (low + high) - lower - higher) / 6 - here


def _around_gaps(runs: Sequence[Run], seconds: float) -> list[tuple[int, int, int, int]]:
    """Pieces of runs that reach so far to either side of a gap in which controls change; none overlaps another."""
    pieces: list[tuple[int, int, int, int]] = []
    for number, run in enumerate(runs):
        differ = (run.control != moved(run, 1).control).any(axis=1)
        begins = np.flatnonzero(differ & ~np.concatenate([[False], differ[:-1]]))
        ends = np.flatnonzero(differ & ~np.concatenate([differ[1:], [False]])) + 1
        reach = max(_ROWS, round(seconds / float(np.median(run.dt))))
        for begin, end in zip(begins.tolist(), ends.tolist(), strict=True):
            first = max(begin - reach, 0)
            if pieces and pieces[-1][0] == number and first < pieces[-1][-1]:
                continue
            pieces.append((number, first, first, min(end + reach, len(run) - 1)))
    some = np.linspace(0, len(pieces) - 1, min(_SEEN, len(pieces))).round().astype(int)
    return [pieces[int(i)] for i in some]


def _left(segments: Segments, engine: Engine, noise: NoiseModel, candidate: Candidate) -> Array:
    """Chi2 of the pieces of each run, ``(R,)``; in those that are far off, as at an impact, more counts little."""
    shooting = Shooting(engine, segments, noise)
    found = shooting.fit([(candidate.effects, candidate.values)], engine.starts(segments), _ROUNDS, hold=True)[0]
    left = segments.samples * np.log1p(np.nan_to_num(found.per_segment, nan=_FAILED) / segments.samples)
    return np.bincount(segments.run, left, len(segments.runs)).astype(float)
