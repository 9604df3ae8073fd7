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

Found = tuple[Fit, Sets, frozenset[tuple[str, str]]]
"""A set, others to begin from, and what seems to be tuned."""

_LONGER = 1.3
"""Times as long as segments are, that others must usually be."""
TIMES, SHORTEST = (1, 2, 4), (1,)
"""As long as segments are that none halved, how often, are those that are asked; and the shortest of these."""
_STRIKING = 2
"""So often at most where something touches: forms that are close in a second are not in four. A spring that is harder
than linear was found on a striker in 4 s, and left 1.14 times the noise there."""
_FEWEST = 10
"""Segments there must be, where they are longer than those that none halved: intervals are judged by their spread."""
_NEAR = 2.0
"""Times the noise that a set leaves at most to be asked over longer ones: of more there is much to see already."""
_LITTLE = 0.5
"""Part of a mismatch that names leave at most."""
_MORE, _MORE_OF_NOTHING = 1.25, 1.1
"""Times what a set leaves of each value, that it must leave over longer ones. Where nothing is missing and nothing
touches, that was 1.04 on 63 machines at most."""
_CLOSE = 10.0
"""Times the noise up to which the longest of them are taken; of more, the shortest."""


def in_longer_segments(
    machine: Machine, numerics: Numerics, start: Start, found: Found, times: Sequence[int] = TIMES
) -> Start | None:
    """What naming begins from over segments as long as a set follows, where that leaves more than noise there.

    Segments are as short as the nominal wants them (:func:`~torch_activegp.diagnosis.preparation.lengths.longest`).
    Where it is far off, they are a quarter of a second, in which a small error makes little: a pendulum without its
    spring, whose damping and dry friction were too small as well, was left at 0.9 times the noise by spring and damping
    in segments of 0.25 s, and at 7 times in those of 1 s. And what is weak shows where the nominal is followed for
    longer: a dry friction on a striker left 1.19 times the noise in 1 s, and 1.9 times in 2 s.

    Not behind a steep filter, where motion is known as the model tells it alone: a drag was found there that had left
    1.19 times the noise in 1 s and left 5 times in 4 s, and a lag of 1 ms and a load of 0.3 % with it.

    Args:
        machine: model and runs.
        numerics: the forms of the model.
        start: what naming began from.
        found: the set, which may be none.
        times: as long as segments that none halved, how often, are those that are asked, the longest first.
    """
    (best, rest, free), shooting = found, start.shooting
    level = best.chi2 / shooting.dof
    missing = best.chi2 - shooting.dof, start.nominal.chi2 - shooting.dof
    much = not level < _NEAR or (best.effects and missing[0] > _LITTLE * missing[1])
    if much or any(run.filters is not None and any(run.filters) for run in machine.fit):
        return None
    most = max(NOISE_ALONE, _MORE * level) if best.effects else max(1.0, _MORE_OF_NOTHING * level)
    more: list[tuple[Shooting, Fit]] = []
    often = [each for each in times if each <= _STRIKING or not numerics.stiff]
    for segments in _longer(machine, shooting.segments, often):
        whole = dataclasses.replace(Shooting(start.engine, segments, shooting.noise), cheap=numerics.coarse)
        there = followed_by(whole, shooting, best)
        if there is None or not _are_longer(there[0].segments, shooting.segments):
            continue
        if there[1].chi2 < most * there[0].dof:
            break
        more.append(there)
        if there[1].chi2 < _CLOSE * there[0].dof:
            break
    return _there(numerics, start, *more[-1], rest, free) if more else None


def shows(start: Start, best: Fit) -> bool:
    """Whether the best set leaves noise alone, or half of what the nominal does: a random force grows with time too.

    A torque of 0.015 N m that is another one at each row is nothing that names explain: a pendulum on which nothing
    else was missing left 1.08 times the noise in 1 s, and 1.8 times in 2 s.

    Args:
        start: what naming began from, over longer segments.
        best: what it ended with.
    """
    noise = start.shooting.dof
    return best.chi2 < max(NOISE_ALONE * noise, noise + _LITTLE * (start.nominal.chi2 - noise))


def _longer(machine: Machine, known: Segments, times: Sequence[int]) -> list[Segments]:
    """Segments that are longer than some, the longest first: those that none halved, and more so if they are enough."""
    each = [(often, uncut(machine, often)) for often in sorted(times, reverse=True)]
    return [some for often, some in each if _are_longer(some, known) and (often == 1 or some.size >= _FEWEST)]


def _there(
    numerics: Numerics, start: Start, whole: Shooting, fit: Fit, rest: Sets, free: frozenset[tuple[str, str]]
) -> Start | None:
    """What naming begins from over the segments of a likelihood, a fit and more sets; None where the nominal fails."""
    bare = whole.fit([((), ())], fit.starts)[0] if fit.effects else fit
    if not np.isfinite(bare.chi2):
        return None
    found = [*([(fit.effects, fit.values)] if fit.effects else []), *besides(rest, fit)]
    engine, shooting, nominal, judged = numerics.choose(whole.segments, whole.noise, fit, bare, found)
    if not np.isfinite(nominal.chi2):
        return None
    return Start(engine, shooting, nominal, besides(found, judged), judged, free, whole.noise, once_more(start.depth))


def _are_longer(some: Segments, others: Segments) -> bool:
    return some.usual_seconds > _LONGER * others.usual_seconds
