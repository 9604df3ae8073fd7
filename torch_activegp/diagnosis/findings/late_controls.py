"""Whether a mismatch that nothing explains is a log whose controls are a row late."""

from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Run, input_addresses
from torch_activegp.diagnosis.selection.explain import Explanation

_BETTER = 0.5
"""Part of what is left otherwise that controls a row earlier may leave to be doubted. A machine does not act before it
is told to: nothing on the list, and little that is missing from it, looks like that."""
_TOLD = 2
"""So many columns are written out."""


def doubt_rows(explanation: Explanation) -> list[str]:
    """Says that the controls seem to be a row late, where a row earlier they leave half of what is left otherwise.

    Or with no name as little as the best names leave. Many loggers write the command that led to a position in its row,
    and a control holds from its row on.

    Args:
        explanation: what was found, and how.

    Returns:
        A sentence; none where that explains nothing, or nothing is driven.
    """
    shooting, selection = explanation.shooting, explanation.selection
    names = list(input_addresses(explanation.engine.model))
    if not names or not any(run.control.any() for run in shooting.segments.runs):
        return []
    segments = dataclasses.replace(shooting.segments, runs=tuple(_earlier(run) for run in shooting.segments.runs))
    moved = dataclasses.replace(shooting, engine=explanation.engine, segments=segments, offset=None)
    best = selection.best
    nameless = moved.fit([((), ())], selection.nominal.starts)[0]
    named = moved.fit([(best.effects, best.values)], best.starts)[0] if best.effects else nameless
    before, after = best.chi2 / shooting.dof, min(nameless.chi2, named.chi2) / shooting.dof
    as_well = bool(best.effects) and nameless.chi2 < best.chi2
    if not (after < _BETTER * before or as_well):
        return []
    maps = [f'ctrl.{name} = {{ column = "ctrl.{name}", rows_late = 1 }}' for name in names[:_TOLD]]
    return [
        f"The controls seem to be logged a row late. A row earlier they leave {after:.3g} times the noise for "
        f"{before:.3g} (chi2 per dof). If a row of your log holds the command that led to its position, say so in a "
        f"column map (--columns MAP.toml): {'; '.join([*maps, *(['...'] if len(names) > _TOLD else [])])}."
    ]


def _earlier(run: Run) -> Run:
    """The run with each control moved up by a row."""
    return dataclasses.replace(run, control=np.concatenate([run.control[1:], run.control[-1:]]))
