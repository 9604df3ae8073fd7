"""Rows of positions that were filtered after they were recorded: only some of them say anything new."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Run
from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.diagnosis.noise.floor import filter_beside, steep_filters
from torch_activegp.diagnosis.preparation.filters_left import filters_left
from torch_activegp.diagnosis.preparation.smeared_motion import given_back


def thinned(machine: Machine, nthread: int = 0) -> Machine:
    """A machine of whose rows only as many count as a filter has left new values, with a note on that.

    The noise behind a steep filter is white in rows that are half a period of its corner apart, and follows from these
    in between; behind a quick one every row counts. No noise of one or two poles is like it. A row counts for all
    joints or for none; so the filter with the lowest corner tells which, and the noise of all of them is taken for
    white in these. What fits leave is not asked for another noise then. Held-out runs stay as they are.

    Args:
        machine: model and runs.
        nthread: threads of the simulations; 0 for all cores.
    """
    found = steep_filters(machine.fit)
    if None in found:
        shown = [one or left for one, left in zip(found, filters_left(machine, nthread), strict=True)]
        found = [one or filter_beside(machine.fit, channel, shown) for channel, one in enumerate(shown)]
    known = {f"qpos.{joint}": one for joint, one in zip(machine.channels.joints, found, strict=True) if one is not None}
    machine, most = given_back(machine, found, nthread)
    if most.any():  # what sharp turns left was taken for noise
        again = filters_left(machine, nthread)
        found = [_quieter(*pair) if size else pair[0] for *pair, size in zip(found, again, most, strict=True)]
    fit = [dataclasses.replace(run, filters=tuple(found)) for run in machine.fit]
    if not known:
        return dataclasses.replace(machine, fit=tuple(fit))
    rows, period = max(one.rows for one in known.values()), float(np.median(machine.fit[0].dt))
    corner = min(one.corner for one in known.values()) / period
    note = f"{', '.join(known)}: filtered at about {corner:.2g} Hz, by the spectrum. What is faster is not seen there"
    if rows > 1:
        fit = [_apart(run, rows * period, 2 * rows) for run in fit]
        note += f", and of all joints one row in {1e3 * rows * period:.3g} ms counts, for noise is new in these"
    if most.any():
        names = zip(machine.channels.joints, machine.channels.units, most, strict=True)
        taken = ", ".join(f"{size:.2g} {unit} of qpos.{joint}" for joint, unit, size in names if size)
        note += f". The filter took up to {taken} from the motion too, which is given back as the model tells it, to "
        note += "held-out runs also"
    return dataclasses.replace(machine, fit=tuple(fit), notes=(*machine.notes, f"{note}. Unfiltered, they tell more."))


def _quieter(one: SteepFilter | None, other: SteepFilter | None) -> SteepFilter | None:
    """A filter with the lower one of two levels of the noise below its corner, where both are known."""
    if one is None or other is None:
        return one
    return one._replace(scale=min(one.scale, other.scale * math.sqrt(one.corner / other.corner)))


def _apart(run: Run, seconds: float, ends: int) -> Run:
    """The run with rows that count so far apart at least, but for jitter, and none of so many at its ends.

    There a filter that ran forth and back has written what it took to come before and after. Of a short piece, which
    may have been cut from a longer run behind the filter, a tenth at most does not count.
    """
    ends = min(ends, len(run) // 10)
    kept, last = np.zeros(len(run), dtype=bool), -np.inf
    counted = np.flatnonzero(run.counted)
    for row in counted[(counted >= ends) & (counted < len(run) - ends)]:
        if run.time[row] - last > seconds - 0.5 * float(np.median(run.dt)):
            kept[row], last = True, run.time[row]
    return dataclasses.replace(run, left_out=run.recorded & ~kept)
