from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.rounded_times import rounding


@pytest.mark.parametrize(
    ("step", "uneven", "found"),
    [
        (3e-4, 0.1, 3e-4),
        (1e-3, 0.1, 1e-3),
        (1e-9, 0.1, 0.0),  # no step shows
        (1e-3, 0.0, 0.0),  # even rows are where they say
        (4e-3, 0.5, 0.0),  # ticks of an exact clock
    ],
)
def test_the_step_shows_where_rows_are_uneven(clean, step: float, uneven: float, found: float) -> None:
    run, rng = clean.segments.runs[0], np.random.default_rng(0)
    time = run.time + uneven * run.dt.mean() * rng.uniform(-1.0, 1.0, len(run.time))
    assert rounding(dataclasses.replace(run, time=np.round(time / step) * step)) == pytest.approx(found)


@pytest.mark.parametrize("filled", [True, False])
def test_rows_that_are_missing_make_no_even_clock_uneven(clean, filled: bool) -> None:
    run = clean.segments.runs[0]
    kept = np.ones(len(run.time), dtype=bool)
    kept[[7, 20, 21, 40]] = False
    if filled:
        assert rounding(dataclasses.replace(run, recorded=kept)) == 0.0
    else:
        assert rounding(dataclasses.replace(run, time=run.time[kept], recorded=np.ones(kept.sum(), dtype=bool))) == 0.0
