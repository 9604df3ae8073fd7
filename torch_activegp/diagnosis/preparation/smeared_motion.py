"""What a filter that positions went through took from the motion, and not from the noise alone."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Array, Run, median_step
from torch_activegp.diagnosis.inputs.segments import Segments, lay
from torch_activegp.diagnosis.inputs.steep_filter import REACH, SteepFilter
from torch_activegp.diagnosis.noise.floor import uneven
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.preparation.given_numerics import numerics_of
from torch_activegp.diagnosis.shooting.likelihood import Shooting

_SECONDS = 0.3
_ROUNDS = 20
_TIMES, _USUAL = (1.0, 0.8, 0.9, 1.1, 1.25), (2, 2)
"""Corners that are tried, in parts of the one that a spectrum tells; and an order, and how often it was run."""
_QUICKEST = 0.49
"""Below half the sampling rate."""
_ALIKE, _SURE = 0.2, 0.1
"""How far from one, and how uncertain, the part may be of the nominal's motion about the corner, behind the filter,
that recordings have. On seven machines without a friction, a load or nothing it was 0.85 to 1.06; where sharp turns
came from what was missing (a drive's limit, lag or gain) 0.1, 0.4, 0.6 and 1.4: there it knows none of them."""

Filters = Sequence[SteepFilter | None]


def given_back(machine: Machine, filters: Filters, nthread: int = 0) -> tuple[Machine, Array]:
    """A machine whose recordings have again what a filter took from their motion, as the nominal tells it.

    A joint that turns within some milliseconds, as behind a loop that saturates, has motion beyond the corner of a
    filter that somebody ran over its positions later. Simulations have it: right names left 3.2 times the noise on an
    arm at 28 Hz, and the nominal left 2.4 where nothing was missing. To compare positions with a simulation behind the
    same filter is to give back to them what it takes from the simulation. The nominal knows that in brief pieces, where
    what is missing is slow: about the corner, where the filter leaves some of the motion, the recordings must have what
    it would leave of the nominal's. A filter that runs once comes late too, which is a `sensor_delay`.

    Held-out runs are compared alike, and have no say in whether. Not asked of uneven clocks.

    Args:
        machine: model and runs.
        filters: that each channel went through, or None, C of them.
        nthread: threads of the simulations; 0 for all cores.

    Returns:
        The machine, and what was given back at most, ``(C,)``, rad or m; 0 where nothing was.
    """
    known = {channel: one for channel, one in enumerate(filters) if one is not None}
    runs, most, count = [*machine.fit, *machine.holdout], np.zeros(len(filters)), len(machine.fit)
    if not known or any(map(uneven, runs)):
        return machine, most
    segments, middle = _pieces(runs, math.ceil(REACH / min(one.corner for one in known.values())))
    path = _followed(machine, segments, known, nthread)
    sound = np.flatnonzero(np.isfinite(path).all(axis=(1, 2)))
    for channel, one in known.items():
        taken = _taken(segments, path, middle, sound, channel, one, count)
        for s, some in zip(sound, taken, strict=bool(taken)):
            (first, last), number = middle[s], segments.run[s]
            position = runs[number].position.copy()
            position[first:last, channel] += some
            runs[number] = dataclasses.replace(runs[number], position=position)
            most[channel] = max(most[channel], float(np.abs(some).max()))
    return dataclasses.replace(machine, fit=tuple(runs[:count]), holdout=tuple(runs[count:])), most


def _pieces(runs: Sequence[Run], reach: int) -> tuple[Segments, NDArray[np.int64]]:
    """Pieces of runs that overlap by twice the reach, and the rows that belong to each, ``(S, 2)``."""
    body = max(round(_SECONDS / median_step(runs)), 2 * reach)
    pieces, middle = [], []
    for number, run in enumerate(runs):
        rows = len(run)
        for first in range(0, max(rows - reach, 1), body):
            last = first + body if first + body + reach < rows else rows
            begin = max(first - reach, 0)
            pieces.append((number, begin, begin, min(last + reach, rows - 1)))
            middle.append((first, last))
    return lay(runs, pieces), np.array(middle, dtype=np.int64)


def _followed(machine: Machine, segments: Segments, known: Mapping[int, SteepFilter], nthread: int) -> Array:
    """What the nominal does in pieces, each from its own initial state, ``(S, K + 1, C)``; NaN where it fails."""
    forms, scale = numerics_of(machine, nthread), np.median([run.noise for run in machine.fit], axis=0)
    for channel, one in known.items():
        scale[channel] = max(scale[channel], one.scale)
    engine = forms.late or forms.fine  # of second order: of first order turns come up to half a step late
    shooting = Shooting(engine, segments, NoiseModel.white(scale))
    return shooting.predicted(shooting.fit([((), ())], engine.starts(segments), _ROUNDS)[0])


def _taken(
    segments: Segments,
    path: Array,
    middle: NDArray[np.int64],
    sound: NDArray[np.int64],
    channel: int,
    known: SteepFilter,
    count: int,
) -> list[Array]:
    """What a filter takes from a channel in the rows that belong to each sound piece.

    The filter is the one near the known one behind which the nominal is most alike: where a joint moves up to the
    corner, a spectrum tells that to some 20 %. None where pieces of the first `count` runs do not show it.
    """
    whole = [path[s, : segments.lengths[s] + 1, channel] for s in sound]
    there = [segments.position[s, : len(one), channel] for s, one in zip(sound, whole, strict=True)]
    inside = [slice(*(middle[s] - segments.first[s])) for s in sound]
    counts = [segments.counts[s, : len(one)] & (segments.run[s] < count) for s, one in zip(sound, whole, strict=True)]

    def about_the_corner(some: Sequence[Array]) -> Array:
        """What of it is not far below the corner, in the rows that count."""
        asked = zip(some, inside, counts, strict=True)
        return np.concatenate([np.zeros(0), *((one - known(one))[rows][mine[rows]] for one, rows, mine in asked)])

    shown = about_the_corner(there)
    if not _is_that(about_the_corner([known(one) for one in whole]), shown):
        return []
    left = {one: float(((shown - about_the_corner([one(some) for some in whole])) ** 2).sum()) for one in _near(known)}
    best = min(left, key=left.__getitem__)
    return [(some - best(some))[rows] for some, rows in zip(whole, inside, strict=True)]


def _near(known: SteepFilter) -> list[SteepFilter]:
    """A filter and others with about its corner, and of second order forth and back, the most usual one."""
    orders = dict.fromkeys((known.order, _USUAL))
    corners = [times * known.corner for times in _TIMES if times * known.corner < _QUICKEST]
    return [known._replace(corner=corner, order=order) for order in orders for corner in corners]


def _is_that(asked: Array, shown: Array) -> bool:
    """Whether what is shown is what is asked for, as large, beside noise."""
    size = float(asked @ asked)
    if size == 0.0:
        return False
    part = float(asked @ shown) / size
    error = math.sqrt(float((asked**2) @ (shown - part * asked) ** 2)) / size
    return error < _SURE and abs(part - 1.0) < _ALIKE
