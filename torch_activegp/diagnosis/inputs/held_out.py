"""The runs that are forecast: which of those that were given can be, and which are set aside where none was."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.runs import MIN_ROWS, Run
from torch_activegp.errors import DataError

PAD = 0.1
"""At the beginning of each run it is simulated and counts for nothing, s: what a delay remembers is not recorded."""
SEEN = 0.4
"""Each model has its state from what was recorded so long before, s. States smoothed without a model are too rough to
step from: their velocities make errors several times the noise, behind which no correction shows."""
STEP = 0.1
"""One step ahead means at least this long, s: in one sample a machine hardly moves by more than the noise."""
_SHARE = 0.2


def that_can_be_forecast(runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Runs that can be forecast, with a note on the others; all, where none can.

    Fifteen rows between two gaps were forecast as badly by the true model as by any.
    """
    whole, short = _by_length(runs)
    if not short:
        return whole, []
    others = f" and {len(short) - 1} more" if len(short) > 1 else ""
    return whole, [
        f"{short[0].label}{others}: lasts less than {PAD + SEEN + STEP:g} s and is not forecast, for too little is "
        "recorded there to say where it begins."
    ]


def set_aside(runs: Sequence[Run]) -> tuple[list[Run], list[Run], str]:
    """What to fit and what is only forecast, the last fifth of the runs that can be; or of the longest one, of few.

    Returns:
        What to fit, what to forecast, and a sentence that says which.

    Raises:
        DataError: the longest run is too short to be divided.
    """
    whole, _ = _by_length(runs)
    count = min(max(round(_SHARE * len(runs)), 1), len(whole) - 1)
    if len(runs) >= 3 and count:
        kept = whole[-count:]
        fit = [run for run in runs if not any(run is other for other in kept)]
        return fit, kept, f"No held-out runs given: set aside {', '.join(run.label for run in kept)}."
    longest = max(range(len(runs)), key=lambda i: len(runs[i]))
    cut = int((1 - _SHARE) * len(runs[longest]))
    if len(runs[longest]) - cut < MIN_ROWS:
        raise DataError(
            f"{runs[longest].label}: too short to set the last fifth of it aside, {len(runs[longest])} rows found, "
            f"{math.ceil(MIN_ROWS / _SHARE)} wanted. Record longer, or give held-out runs (--holdout)."
        )
    head, tail = _part(runs[longest], 0, cut, "first part"), _part(runs[longest], cut, len(runs[longest]), "last part")
    others = [run for i, run in enumerate(runs) if i != longest]
    note = f"No held-out runs given, and few runs: set aside the last fifth of {runs[longest].label}."
    return [*others, head], [tail], note


def _by_length(runs: Sequence[Run]) -> tuple[list[Run], list[Run]]:
    """Runs that last as long as a forecast by one step, to half a row, and others; all are of the first, if none is."""
    long = [float(run.time[-1] + 0.5 * np.median(run.dt)) >= PAD + SEEN + STEP for run in runs]
    if not any(long):
        return list(runs), []
    pairs = list(zip(runs, long, strict=True))
    return [run for run, is_long in pairs if is_long], [run for run, is_long in pairs if not is_long]


def _part(run: Run, start: int, stop: int, name: str) -> Run:
    rows = {f: getattr(run, f)[start:stop] for f in ("position", "recorded", "velocity", "smooth")}
    held = {f: getattr(run, f)[start : stop - 1] for f in ("control", "force")}
    time = run.time[start:stop] - run.time[start]
    given = None if run.prescribed is None else _part(run.prescribed, start, stop, name)
    rows["left_out"] = None if run.left_out is None else run.left_out[start:stop]
    return dataclasses.replace(run, label=f"{run.label} ({name})", time=time, prescribed=given, **rows, **held)
