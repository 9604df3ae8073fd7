"""Pieces of the runs so brief that initial states say nearly all: where segments begin, and which form is close."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from torch_activegp.diagnosis.inputs.machine import Machine
from torch_activegp.diagnosis.inputs.runs import Array, Run, median_step
from torch_activegp.diagnosis.inputs.segments import Segments, cut, lay
from torch_activegp.diagnosis.noise.model import NoiseModel
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.diagnosis.shooting.likelihood import Shooting
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.forms import Forms

_SECONDS, _ROWS = 0.06, 12
_LONGEST = 0.125
"""Where rows are so far apart that pieces take longer, s, they are not brief."""
_ROUNDS = 8
_SEEN = 24
"""Pieces in which forms are compared."""
_CLEARLY, _CLOSE = 0.8, 1.15
"""A cheap form is left for one that leaves less than the first part of it there; of those as close as the second, the
cheapest is taken."""


def seconds_of(runs: Sequence[Run]) -> float:
    """How long pieces are, s."""
    return max(_SECONDS, _ROWS * median_step(runs))


def brief(runs: Sequence[Run]) -> Segments | None:
    """The runs in pieces; None where rows are too far apart.

    Without a lead: what stuck in a tenth of a second before a piece would be in no recording.
    """
    seconds = seconds_of(runs)
    return cut(runs, seconds, 0.0) if seconds <= _LONGEST else None


def begun(shooting: Shooting) -> Array:
    """Initial states of segments, ``(S, nq + nv)``: those by which a brief piece at the begin of each is followed best.

    A smoothed recording knows nothing of the speeds at an impact, and no derivative leads from one side of it to the
    other: half-cheetah's segments of 1 s were left at 1 to 10 times the noise in one of four from there, and at the
    noise all of them from these.

    Args:
        shooting: the likelihood.
    """
    return _followed(shooting).starts


def left_in_brief(shooting: Shooting, engine: Engine, fit: Fit | None = None) -> float:
    """Chi2 that a form leaves in brief pieces where segments begin: as many times the median as there are pieces.

    Over longer ones of a machine that touches something, a form that is close does not show before it was fitted.

    Args:
        shooting: the likelihood.
        engine: the form.
        fit: the effects that are there; None for none.
    """
    found = _followed(dataclasses.replace(shooting, engine=engine), fit)
    return float(np.median(found.per_segment) * len(found.per_segment))


def closest(forms: Forms, machine: Machine, noise: NoiseModel) -> Engine:
    """The form to begin with: the cheap one, but where something touches and another is clearly closer.

    Nothing else can be learned under a form that is off: where a half-cheetah's steps of 10 ms stood for those of 2 ms,
    they left 200 times the noise over a second, and 6 times in pieces of 0.12 s, the right ones 0.8 times.

    Args:
        forms: of the model.
        machine: model and runs.
        noise: of the recordings.
    """
    pieces = brief(machine.fit) if forms.stiff else None
    if pieces is None:
        return forms.coarse
    shooting, _ = Shooting(forms.coarse, pieces, noise).subset(_SEEN / pieces.size)
    rivals = dict.fromkeys((forms.coarse, forms.fine, *forms.own))
    leaves = {engine: left_in_brief(shooting, engine) for engine in rivals}
    least = min(leaves.values())
    if least > _CLEARLY * leaves[forms.coarse]:
        return forms.coarse
    near = [engine for engine, chi2 in leaves.items() if chi2 <= _CLOSE * least]
    return min(near, key=lambda engine: engine.steps_in(shooting.segments))


def _heads(segments: Segments) -> Segments:
    """A brief piece at the begin of each segment."""
    rows = int(np.ceil(seconds_of(segments.runs) / median_step(segments.runs)))
    last = np.array([len(run) - 1 for run in segments.runs])[segments.run]
    pieces = np.stack([segments.run, segments.first, segments.first, np.minimum(segments.first + rows, last)], axis=1)
    return lay(segments.runs, pieces.tolist())


def _followed(shooting: Shooting, fit: Fit | None = None) -> Fit:
    """The initial states of brief pieces where segments begin, with effects held as they are."""
    pieces = dataclasses.replace(shooting, segments=_heads(shooting.segments), offset=None)
    what = ((), ()) if fit is None else (fit.effects, fit.values)
    return pieces.fit([what], pieces.engine.starts(pieces.segments), _ROUNDS, hold=True)[0]
