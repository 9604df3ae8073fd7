"""Whether a mismatch that nothing explains is a log whose controls are a row late."""

from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.inputs.runs import Run, input_addresses
from torch_activegp.diagnosis.preparation.telling import enough
from torch_activegp.diagnosis.selection.explain import Explanation

_BETTER = 0.5
"""Part of what is left otherwise that controls a row earlier may leave to be doubted: a machine does not act before it
is told to, so nothing on the list looks like that. On an arm of two joints a row earlier left 6 for 48 times the
noise."""
_TOLD = 3
"""So many columns are written out."""


def doubt_rows(explanation: Explanation) -> list[str]:
    """Says that the controls seem to be a row late, where a row earlier they leave half of what is left otherwise.

    Or half of what the nominal leaves, with no name and less than the best names do. Many loggers write the command
    that led to a position in its row, and a control holds from its row on.

    Args:
        explanation: what was found, and how.

    Returns:
        A sentence; none where that explains nothing, or nothing is driven.
    """
    shooting, selection = explanation.shooting, explanation.selection
    runs = shooting.segments.runs
    inputs = input_addresses(explanation.engine.model).items()
    names = [name for name, at in inputs if any(np.ptp(run.control[:, at]) > 0.0 for run in runs)]
    if not names:
        return []
    segments = dataclasses.replace(shooting.segments, runs=tuple(_earlier(run) for run in runs))
    moved = dataclasses.replace(shooting, engine=explanation.engine, segments=segments, offset=None)
    # where a row earlier explains nothing, fits to all segments go on for long
    part = shooting.subset(enough(explanation.engine, segments), selection.nominal.per_segment)[1]
    for which in (*([part] if len(part) < segments.size else []), np.arange(segments.size)):
        some, nominal, best = moved.pick(which), selection.nominal.pick(which), selection.best.pick(which)
        nameless = some.fit([((), ())], nominal.starts)[0]
        named = some.fit([(best.effects, best.values)], best.starts)[0] if best.effects else nameless
        before, after = best.chi2 / some.dof, min(nameless.chi2, named.chi2) / some.dof
        as_well = nameless.chi2 < min(best.chi2, _BETTER * nominal.chi2)
        if not (after < _BETTER * before or as_well):
            return []
    columns = [f"ctrl.{name}" for name in names]
    told = ", ".join([*columns[:_TOLD], *(["..."] if len(columns) > _TOLD else [])])
    return [
        f"The controls seem to be logged a row late. A row earlier they leave {after:.3g} times the noise for "
        f"{before:.3g} (chi2 per dof). If a row of your log holds the command that led to its position, add "
        f"`rows_late = 1` to their lines ({told}) in a column map (--columns MAP.toml), as in {columns[0]} = "
        "{ rows_late = 1 }, with what is there."
    ]


def _earlier(run: Run) -> Run:
    """The run with controls and forces moved up by a row that was recorded."""
    known = np.flatnonzero(run.recorded)
    after = np.searchsorted(known, np.arange(len(run) - 1), side="right")
    rows = np.minimum(known[np.minimum(after, len(known) - 1)], len(run) - 2)
    return dataclasses.replace(run, control=run.control[rows], force=run.force[rows])
