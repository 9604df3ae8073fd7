"""The likelihood with controls that are read in another way."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from torch_activegp.diagnosis.inputs.runs import Run, input_addresses
from torch_activegp.diagnosis.preparation.telling import enough
from torch_activegp.diagnosis.selection.explain import Explanation
from torch_activegp.diagnosis.shooting.likelihood import Shooting


def driven(explanation: Explanation) -> dict[str, int]:
    """Controls that change, and where they are in a row."""
    runs, inputs = explanation.shooting.segments.runs, input_addresses(explanation.engine.model)
    return {name: at for name, at in inputs.items() if any(np.ptp(run.control[:, at]) > 0.0 for run in runs)}


def with_controls(explanation: Explanation, change: Callable[[Run], Run]) -> Shooting:
    """The likelihood with changed controls, within the limits of the columns where they are now."""
    shooting, limits = explanation.shooting, explanation.engine.limits
    changed = map(change, shooting.segments.runs)
    runs = tuple(dataclasses.replace(run, control=np.clip(run.control, *limits)) for run in changed)
    segments = dataclasses.replace(shooting.segments, runs=runs)
    return dataclasses.replace(shooting, engine=explanation.engine, segments=segments, offset=None)


def parts_of(explanation: Explanation) -> list[NDArray[np.int64]]:
    """Some segments, then all: where a change explains nothing, fits to all go on for long."""
    shooting, nominal = explanation.shooting, explanation.selection.nominal
    part = shooting.subset(enough(explanation.engine, shooting.segments), nominal.per_segment)[1]
    return [*([part] if len(part) < shooting.segments.size else []), np.arange(shooting.segments.size)]
