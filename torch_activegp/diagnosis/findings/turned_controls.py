"""Whether a mismatch that nothing explains is a log whose controls are turned, or in each other's place."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.findings.changed_controls import driven, parts_of, with_controls
from torch_activegp.diagnosis.findings.doubts import DOUBTED_LEFT, MUCH_LEFT
from torch_activegp.diagnosis.inputs.runs import Run, input_addresses
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.simulation.candidate import NOMINAL

Change = TypeVar("Change")

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
    signs = {name: functools.partial(_turned, at=at) for name, at in driven(explanation).items()}
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
    found, parts = list[tuple[float, Change]](), parts_of(explanation)
    for which in _nearest(explanation, changes, parts[0]):
        changed, left = with_controls(explanation, changes[which]), np.inf
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
        part = with_controls(explanation, change).pick(rows)
        white = part.residuals_from(part.engine.starts(part.segments)[None], [NOMINAL])
        left[which] = float((white**2).sum())
    return sorted((which for which in left if np.isfinite(left[which])), key=left.__getitem__)[:_TRIED]


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
