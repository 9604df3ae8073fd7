"""Whether a mismatch that nothing explains is a log whose controls act in other rows, or between them."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from torch_activegp.data.spline_means import spline_means
from torch_activegp.diagnosis.findings.changed_controls import driven, parts_of, with_controls
from torch_activegp.diagnosis.findings.doubts import MUCH_LEFT
from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.preparation.late import LIKE_A_TIME_STEP
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.selection.judge import Judgement

_BETTER, _MUCH_BETTER = 0.5, 0.1
"""Parts of what is left otherwise that controls a row earlier may leave to be doubted, where that is little and where
it is much: a machine does not act before it is told to, so nothing on the list looks like that. On an arm of two joints
a row earlier left 6 for 48 times the noise. Commands that were logged before a limiter left 1e5 for 4e5."""
_CLEARLY = 0.95
"""Part of what another reading leaves that one must leave to be told in its place."""
_ABOUT_HALF = 0.15
"""Rows by which a delay may be off half a one."""
_TOLD = 3
"""So many columns are written out."""


def _earlier(run: Run) -> Run:
    """The run with controls and forces moved up by a row that was recorded."""
    known = np.flatnonzero(run.recorded)
    after = np.searchsorted(known, np.arange(len(run) - 1), side="right")
    rows = np.minimum(known[np.minimum(after, len(known) - 1)], len(run) - 2)
    return dataclasses.replace(run, control=run.control[rows], force=run.force[rows])


def _evenly(run: Run) -> Run:
    """The run with controls and forces that change evenly to the next row that was recorded: the means are held."""
    next_one = _earlier(run)
    control, force = 0.5 * (run.control + next_one.control), 0.5 * (run.force + next_one.force)
    return dataclasses.replace(run, control=control, force=force)


def _smoothly(run: Run) -> Run:
    """The run with the means from row to row of controls and forces along cubic splines through recorded rows."""
    known = np.flatnonzero(run.recorded[:-1])
    if len(known) < 4:
        return _evenly(run)
    clock, time = np.minimum(run.time, run.time[known[-1]]), run.time[known]
    control, force = (spline_means(time, held[known], clock) for held in (run.control, run.force))
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


_Told = tuple[tuple[float, float], _Reading]
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
    _Reading(
        _smoothly,
        "change smoothly from row to row, where each is taken to hold until the next",
        "Changing so",
        "your log holds samples of commands that change all the time",
        "hold_order = 3",
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
    names = list(driven(explanation))
    if not names:
        return []
    found = [(left, reading) for reading in _READINGS if (left := _left_so(explanation, reading.change)) is not None]
    if not found:
        return []
    (after, before), (_, seem, so, where, setting) = functools.reduce(_better, found)
    columns = [f"ctrl.{name}" for name in names]
    told = ", ".join([*columns[:_TOLD], *(["..."] if len(columns) > _TOLD else [])])
    return [
        f"The controls seem to {seem}. {so} they leave {after:.3g} times the noise for {before:.3g} (chi2 per dof). "
        f"If {where}, add `{setting}` to their lines ({told}) in a column map (--columns MAP.toml), as in {columns[0]} "
        f"= {{ {setting} }}, with what is there."
    ]


def _better(one: _Told, other: _Told) -> _Told:
    """The reading that leaves less; of two that leave about as much the first."""
    return other if other[0][0] < _CLEARLY * one[0][0] else one


def _left_so(explanation: Explanation, change: Callable[[Run], Run]) -> tuple[float, float] | None:
    """Chi2 per degree of freedom with changed controls and without; None where these do not explain the mismatch."""
    selection, changed = explanation.selection, with_controls(explanation, change)
    after = before = 0.0
    for which in parts_of(explanation):
        some, nominal, best = changed.pick(which), selection.nominal.pick(which), selection.best.pick(which)
        nameless = some.fit([((), ())], nominal.starts)[0]
        named = some.fit([(best.effects, best.values)], best.starts)[0] if best.effects else nameless
        before, after = best.chi2 / some.dof, min(nameless.chi2, named.chi2) / some.dof
        as_well = nameless.chi2 < min(best.chi2, _BETTER * nominal.chi2)
        if not (after < _BETTER * before or as_well) or after > max(MUCH_LEFT, _MUCH_BETTER * before):
            return None
    return after, before


def half_a_row(judgement: Judgement, notes: Sequence[str], step: float) -> list[str]:
    """Doubts a named delay of half a row where controls are said to change from row to row: held ones look like that.

    A staircase that was read so was a `sensor_delay` of 5.6 ms at 100 Hz, where nothing was missing.

    Args:
        judgement: the verdict.
        notes: on the recordings, which say so.
        step: the time between rows, s.
    """
    values = judgement.fit.by_effect
    late = [effect for effect in judgement.named if effect.name in LIKE_A_TIME_STEP]
    half = [effect for effect in late if abs(values[effect][0] / step - 0.5) < _ABOUT_HALF]
    if not half or not any("(hold_order = " in note for note in notes):
        return []
    name, target = half[0].key
    return [
        f"{name} at {target} is about half a row ({0.5e3 * step:.3g} ms): controls that are held and are read as if "
        "they changed from row to row look like that. If they are held, take `hold_order` out of the column map."
    ]
