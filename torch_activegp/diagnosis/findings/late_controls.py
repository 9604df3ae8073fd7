"""Whether a mismatch that nothing explains is a log whose controls act in other rows, turned, or in other places."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.findings.doubts import DOUBTED_LEFT, MUCH_LEFT
from torch_activegp.diagnosis.inputs.runs import Run, input_addresses
from torch_activegp.diagnosis.preparation.telling import enough
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.candidate import NOMINAL

Change = TypeVar("Change")

_BETTER, _MUCH_BETTER = 0.5, 0.1
"""Parts of what is left otherwise that controls a row earlier may leave to be doubted, where that is little and where
it is much: a machine does not act before it is told to, so nothing on the list looks like that. On an arm of two joints
a row earlier left 6 for 48 times the noise. Commands that were logged before a limiter left 1e5 for 4e5."""
_TURNED, _INTERCHANGED = 0.2, 0.02
"""Parts of what the nominal leaves that it may leave with a control turned, or two interchanged, for a doubt of them.
Two controls with two signs can be interchanged in more ways than one is turned: joints of which one was recorded with
the other sign, pulled by two tendons, left 1.6e5 times the noise with the tendons interchanged."""
_NEAR = 10.0
"""Times what the best names leave that it may leave so at most, where these leave much: a control turned left 8
thousand times the noise beside three names' 2400, whose place it took, and positions in degrees 323 thousand beside 14.
"""
_TRIED = 3
"""Changes that are fitted, those that come nearest without a fit: all 66 pairs of 12 drives took 131 s."""
_TOLD = 3
"""So many columns are written out."""


def _earlier(run: Run) -> Run:
    """The run with controls and forces moved up by a row that was recorded."""
    known = np.flatnonzero(run.recorded)
    after = np.searchsorted(known, np.arange(len(run) - 1), side="right")
    rows = np.minimum(known[np.minimum(after, len(known) - 1)], len(run) - 2)
    return dataclasses.replace(run, control=run.control[rows], force=run.force[rows])


def _evenly(run: Run) -> Run:
    """The run with controls and forces that change evenly from each row to the next: the means of both are held."""
    control, force = (0.5 * (held + np.concatenate([held[1:], held[-1:]])) for held in (run.control, run.force))
    return dataclasses.replace(run, control=control, force=force)


class _Reading(NamedTuple):
    """Another way to read the rows of controls.

    Args:
        change: the run read so.
        seem: what the controls seem to do.
        so: when what they leave is told of.
        where: what the log is like then.
        setting: line of a column map for it.
    """

    change: Callable[[Run], Run]
    seem: str
    so: str
    where: str
    setting: str


_READINGS = (
    _Reading(
        _earlier,
        "be logged a row late",
        "A row earlier",
        "a row of your log holds the command that led to its position",
        "rows_late = 1",
    ),
    _Reading(
        _evenly,
        "change evenly from row to row, where each is taken to hold until the next",
        "Changing so",
        "your log holds samples of commands that change all the time, or the machine interpolates them",
        "hold_order = 1",
    ),
)


def doubt_rows(explanation: Explanation) -> list[str]:
    """Says that the controls seem to be a row late, or to change evenly within rows, where these leave half so.

    Half of what is left otherwise; or half of what the nominal leaves, with no name and less than the best names do; a
    tenth where that is much. Many loggers write the command that led to a position in its row, and a control holds from
    its row on; others write samples of a command that changes all the time.

    Args:
        explanation: what was found, and how.

    Returns:
        A sentence; none where neither explains anything, or nothing is driven.
    """
    names = list(_driven(explanation))
    if not names:
        return []
    found = [(left, reading) for reading in _READINGS if (left := _left_so(explanation, reading.change)) is not None]
    if not found:
        return []
    (after, before), (_, seem, so, where, setting) = min(found, key=lambda one: one[0])
    columns = [f"ctrl.{name}" for name in names]
    told = ", ".join([*columns[:_TOLD], *(["..."] if len(columns) > _TOLD else [])])
    return [
        f"The controls seem to {seem}. {so} they leave {after:.3g} times the noise for {before:.3g} (chi2 per dof). "
        f"If {where}, add `{setting}` to their lines ({told}) in a column map (--columns MAP.toml), as in {columns[0]} "
        f"= {{ {setting} }}, with what is there."
    ]


def _left_so(explanation: Explanation, change: Callable[[Run], Run]) -> tuple[float, float] | None:
    """Chi2 per degree of freedom with changed controls and without; None where these do not explain the mismatch."""
    selection, changed = explanation.selection, _with(explanation, change)
    after = before = 0.0
    for which in _parts(explanation):
        some, nominal, best = changed.pick(which), selection.nominal.pick(which), selection.best.pick(which)
        nameless = some.fit([((), ())], nominal.starts)[0]
        named = some.fit([(best.effects, best.values)], best.starts)[0] if best.effects else nameless
        before, after = best.chi2 / some.dof, min(nameless.chi2, named.chi2) / some.dof
        as_well = nameless.chi2 < min(best.chi2, _BETTER * nominal.chi2)
        if not (after < _BETTER * before or as_well) or after > max(MUCH_LEFT, _MUCH_BETTER * before):
            return None
    return after, before


def doubt_signs(explanation: Explanation) -> list[str]:
    """Says which control seems to have the other sign: turned, the simulator leaves far less without any name.

    Beside friction and a load that are missing too, the forces that a motion takes do not tell. Behind a motor of an
    arm that was wired the other way round three names left 2400 times the noise; the simulator left 135 thousand, and
    8 thousand with the control turned.

    Args:
        explanation: what was found, and how.

    Returns:
        A sentence; none where that is little, or no control does so.
    """
    signs = {name: functools.partial(_turned, at=at) for name, at in _driven(explanation).items()}
    found = _mended(explanation, signs, _TURNED)
    if found is None:
        return []
    name, left, before = found
    return [
        f"Column `ctrl.{name}`: the sign seems to be the other way round. Turned, the simulator leaves {left:.3g} "
        f"times the noise for {before:.3g} (chi2 per dof), without any effect. If so, say it in a column map "
        f"(--columns MAP.toml): ctrl.{name} = {{ sign = -1 }}, or without that where it is there."
    ]


def doubt_places(explanation: Explanation) -> list[str]:
    """Says which two controls seem to have each other's column: as in :func:`doubt_signs`.

    One of them may rest. More than two at once are not tried.

    Args:
        explanation: what was found, and how.

    Returns:
        A sentence; none where that is little, or no two controls do so.
    """
    runs = explanation.shooting.segments.runs
    pairs = itertools.combinations(input_addresses(explanation.engine.model).items(), 2)
    swaps = {
        (a, b): functools.partial(_swapped, first=i, second=j)
        for (a, i), (b, j) in pairs
        if any((run.control[:, i] != run.control[:, j]).any() for run in runs)
    }
    found = _mended(explanation, swaps, _INTERCHANGED)
    if found is None:
        return []
    (one, other), left, before = found
    return [
        f"Columns `ctrl.{one}` and `ctrl.{other}` seem to be interchanged, or those of the joints that they move. With "
        f"each control in the other's place the simulator leaves {left:.3g} times the noise for {before:.3g} (chi2 per "
        f"dof), without any effect. If so, say it in a column map (--columns MAP.toml), ctrl.{one} = {{ column = "
        f'"ctrl.{other}" }} in one line and ctrl.{other} = {{ column = "ctrl.{one}" }} in the next, or interchange the '
        "columns that are there."
    ]


def _mended(
    explanation: Explanation, changes: Mapping[Change, Callable[[Run], Run]], share: float
) -> tuple[Change, float, float] | None:
    """The change of the controls behind which the simulator leaves far less without any name.

    Args:
        explanation: what was found, and how.
        changes: by what they are called.
        share: part of what the nominal leaves that it may leave so.

    Returns:
        Which, and chi2 per degree of freedom with and without it; None where none does.
    """
    shooting, selection = explanation.shooting, explanation.selection
    most = _NEAR * selection.best.chi2
    if selection.best.chi2 < MUCH_LEFT * shooting.dof:
        most = min(selection.best.chi2, DOUBTED_LEFT * shooting.dof)
    found, parts = list[tuple[float, Change]](), _parts(explanation)
    for which in _nearest(explanation, changes, parts[0]):
        changed, left = _with(explanation, changes[which]), np.inf
        for rows in parts:
            part = changed.pick(rows)  # from the recording: states of a simulator that is so wrong lead nowhere
            left = part.fit([((), ())], part.engine.starts(part.segments))[0].chi2
            if not left < share * selection.nominal.pick(rows).chi2:
                break
        else:
            if left < most:
                found.append((left / shooting.dof, which))
    if not found:
        return None
    left, which = min(found, key=lambda one: one[0])
    return which, left, selection.nominal.chi2 / shooting.dof


def _nearest(
    explanation: Explanation, changes: Mapping[Change, Callable[[Run], Run]], rows: NDArray[np.int64]
) -> list[Change]:
    """The few changes behind which the simulator stays nearest to some segments from where these begin, unfitted."""
    left = {}
    for which, change in changes.items():
        part = _with(explanation, change).pick(rows)
        white = part.residuals_from(part.engine.starts(part.segments)[None], [NOMINAL])
        left[which] = float((white**2).sum())
    return sorted((which for which in left if np.isfinite(left[which])), key=left.__getitem__)[:_TRIED]


def _driven(explanation: Explanation) -> dict[str, int]:
    """Controls that change, and where they are in a row."""
    runs, inputs = explanation.shooting.segments.runs, input_addresses(explanation.engine.model)
    return {name: at for name, at in inputs.items() if any(np.ptp(run.control[:, at]) > 0.0 for run in runs)}


def _with(explanation: Explanation, change: Callable[[Run], Run]) -> Shooting:
    """The likelihood with changed controls, within the limits of the columns where they are now."""
    shooting, limits = explanation.shooting, explanation.engine.limits
    changed = map(change, shooting.segments.runs)
    runs = tuple(dataclasses.replace(run, control=np.clip(run.control, *limits)) for run in changed)
    segments = dataclasses.replace(shooting.segments, runs=runs)
    return dataclasses.replace(shooting, engine=explanation.engine, segments=segments, offset=None)


def _parts(explanation: Explanation) -> list[NDArray[np.int64]]:
    """Some segments, then all: where a change explains nothing, fits to all go on for long."""
    shooting, nominal = explanation.shooting, explanation.selection.nominal
    part = shooting.subset(enough(explanation.engine, shooting.segments), nominal.per_segment)[1]
    return [*([part] if len(part) < shooting.segments.size else []), np.arange(shooting.segments.size)]


def _turned(run: Run, at: int) -> Run:
    """The run with the other sign of a control."""
    control = run.control.copy()
    control[:, at] *= -1.0
    return dataclasses.replace(run, control=control)


def _swapped(run: Run, first: int, second: int) -> Run:
    """The run with two controls in each other's place."""
    control = run.control.copy()
    control[:, [first, second]] = control[:, [second, first]]
    return dataclasses.replace(run, control=control)
