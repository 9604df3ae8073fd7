"""Longer segments behind names that follow the machine over them: what small errors do grows with time."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.segments import Segments
from torch_activegp.diagnosis.preparation.late import Sets
from torch_activegp.diagnosis.preparation.lengths import followed_by, uncut
from torch_activegp.diagnosis.preparation.numerics import Numerics
from torch_activegp.diagnosis.selection.first_names import besides
from torch_activegp.diagnosis.selection.start import Start, once_more
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.shooting.score import NOISE_ALONE

_LONGER = 1.3
"""Times as long as segments are, that others must usually be."""
_NEAR = 2.0
"""Times the noise that names leave at most to be asked over longer ones: of more there is much to see already."""
_LITTLE = 0.5
"""Part of a mismatch that names leave at most."""
_MORE = 1.25
"""Times what they leave of each value, that they must leave over longer ones."""
TIMES = (1, 2, 4)


Found = tuple[Fit, Sets, frozenset[tuple[str, str]]]
"""A set, others to begin from, and what seems to be tuned."""


def in_longer_segments(
    machine: Machine,
    numerics: Numerics,
    start: Start,
    found: Found,
    times: Sequence[int] = TIMES,
) -> Start | None:
    """What naming begins from over segments as long as a set follows, where that leaves more than noise there.

    Segments are as short as the nominal wants them (:func:`~torch_activegp.diagnosis.preparation.lengths.longest`).
    Where it is far off, they are a quarter of a second, in which a small error makes little: a pendulum without its
    spring, whose damping and dry friction were too small as well, was left at 0.9 times the noise by spring and damping
    in segments of 0.25 s, and at 35 times in those of 1 s.

    Args:
        machine: model and runs.
        numerics: the forms of the model.
        start: what naming began from.
        found: the set.
        times: as long as uncut ones, how often, are the segments that are looked at. The longest come first, and the
            shortest of those in which more is left are taken.
    """
    (best, rest, free), shooting = found, start.shooting
    level, mismatch = best.chi2 / shooting.dof, start.nominal.chi2 - shooting.dof
    if not best.effects or not level < _NEAR or best.chi2 - shooting.dof > _LITTLE * mismatch:
        return None
    more: tuple[Shooting, Fit] | None = None
    segments = shooting.segments
    for often in sorted(times, reverse=True):
        segments, before = uncut(machine, often), segments
        if not _are_longer(segments, shooting.segments):
            break
        if segments.size == before.size:
            continue
        whole = dataclasses.replace(Shooting(start.engine, segments, shooting.noise), cheap=numerics.coarse)
        there = followed_by(whole, shooting, best)
        if there is None or not _are_longer(there[0].segments, shooting.segments):
            continue
        if there[1].chi2 < max(NOISE_ALONE, _MORE * level) * there[0].dof:
            break
        more = there
    return None if more is None else _there(numerics, start, *more, [(best.effects, best.values), *rest], free)


def _there(
    numerics: Numerics, start: Start, whole: Shooting, fit: Fit, sets: Sets, free: frozenset[tuple[str, str]]
) -> Start | None:
    """What naming begins from over the segments of a likelihood; None where the nominal fails there."""
    bare = whole.fit([((), ())], fit.starts)[0]
    if not np.isfinite(bare.chi2):
        return None
    found = [(fit.effects, fit.values), *besides(sets, fit)]
    engine, shooting, nominal, judged = numerics.choose(whole.segments, whole.noise, fit, bare, found)
    if not np.isfinite(nominal.chi2):
        return None
    return Start(engine, shooting, nominal, besides(found, judged), judged, free, start.noise, once_more(start.depth))


def _are_longer(some: Segments, others: Segments) -> bool:
    return some.usual_seconds > _LONGER * others.usual_seconds
