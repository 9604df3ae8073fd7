from __future__ import annotations

import dataclasses

import numpy as np

from torch_activegp.diagnosis.inputs.steep_filter import SteepFilter
from torch_activegp.diagnosis.selection.behind_noise import (
    BEHIND_A_FILTER,
    BEHIND_A_FLOOR,
    BEHIND_COLOUR,
    least_gain,
)


def test_what_names_leave_may_be_the_colour_of_noise_or_a_floor_that_is_low(bench) -> None:
    shooting, segments = bench.shooting, bench.shooting.segments
    near, far = (dataclasses.replace(bench.nominal, chi2=part * shooting.dof) for part in (1.04, 1.06))

    def least(fit=near, **changed) -> float:
        return least_gain(dataclasses.replace(shooting, **changed), fit)

    assert [least(), least(far)] == [BEHIND_A_FLOOR, np.inf]
    slow = dataclasses.replace(segments, dt=np.full_like(segments.dt, 0.02))
    assert least(far, segments=slow) == BEHIND_COLOUR
    videos = tuple(dataclasses.replace(run, video=True) for run in segments.runs)
    assert least(segments=dataclasses.replace(slow, runs=videos)) == np.inf
    coloured = dataclasses.replace(shooting.noise, colour=np.ones_like(shooting.noise.colour))
    assert least(far, noise=coloured) == BEHIND_COLOUR
    behind = tuple(dataclasses.replace(run, filters=(SteepFilter(0.3, 1e-3),)) for run in segments.runs)
    filtered = dataclasses.replace(segments, runs=behind)
    assert least(segments=filtered) == least(far, segments=filtered) == BEHIND_A_FILTER
    unfiltered = tuple(dataclasses.replace(run, filters=(None,)) for run in segments.runs)
    assert least(segments=dataclasses.replace(segments, runs=unfiltered)) == BEHIND_A_FLOOR
    lost = tuple(dataclasses.replace(run, recorded=np.arange(len(run)) % 2 == 0) for run in segments.runs)
    assert least(segments=dataclasses.replace(segments, runs=lost)) == BEHIND_A_FLOOR
