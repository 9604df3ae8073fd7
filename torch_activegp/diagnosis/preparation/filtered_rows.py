"""Rows of positions that were filtered after they were recorded: only some of them say anything new."""

from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.noise.floor import steep_filters


def thinned(machine: Machine) -> Machine:
    """A machine of whose rows only as many count as a filter has left new values, with a note on that.

    The noise behind a steep filter is white in rows that are half a period of its corner apart, and follows from these
    in between. No noise of one or two poles is like it. A row counts for all joints or for none; so the filter with the
    lowest corner tells which, and the noise of all of them is taken for white in these. What fits leave is not asked
    for another noise then. Held-out runs stay as they are.

    Args:
        machine: model and runs.
    """
    found = steep_filters(machine.fit)
    shelves = {f"qpos.{joint}": s for joint, s in zip(machine.channels.joints, found, strict=True) if s is not None}
    rows = max((one.rows for one in shelves.values()), default=1)
    if rows < 2:
        return machine
    period = float(np.median(machine.fit[0].dt))
    corner = min(one.corner for one in shelves.values()) / period
    note = (
        f"{', '.join(shelves)}: filtered at about {corner:.2g} Hz, as the spectrum shows. What is faster is not seen "
        f"there, and of all joints one row in {1e3 * rows * period:.3g} ms counts, for noise is new in these. "
        "Unfiltered, they tell more."
    )
    fit = tuple(_apart(run, rows * period) for run in machine.fit)
    return dataclasses.replace(machine, fit=fit, notes=(*machine.notes, note))


def _apart(run: Run, seconds: float) -> Run:
    """The run with rows that count so far apart at least, but for jitter."""
    kept, last = np.zeros(len(run), dtype=bool), -np.inf
    for row in np.flatnonzero(run.counted):
        if run.time[row] - last > seconds - 0.5 * float(np.median(run.dt)):
            kept[row], last = True, run.time[row]
    return dataclasses.replace(run, left_out=run.recorded & ~kept)
