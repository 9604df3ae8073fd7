from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.rounded_clock import left_by_rounding, rounded_clock, rounding
from torch_activegp.diagnosis.inputs.segments import lay
from torch_activegp.diagnosis.simulation.candidate import NOMINAL

LEVEL = 1e-4


def recorded(clean, step: float, uneven: float = 0.1):
    """The likelihood and fit of a perfect model by an uneven clock whose times were rounded to a step."""
    rng, segments = np.random.default_rng(0), clean.segments
    clocks = [run.time + uneven * run.dt.mean() * rng.uniform(-1.0, 1.0, len(run.time)) for run in segments.runs]
    pieces = [*zip(segments.run, segments.first, *segments.scored.T, strict=True)]
    exact, told = (
        lay([dataclasses.replace(r, time=t) for r, t in zip(segments.runs, times, strict=True)], pieces)
        for times in (clocks, [np.round(clock / step) * step for clock in clocks])
    )
    true = clean.engine.predict(exact, clean.nominal.starts[None], [NOMINAL])[0]
    position = true + LEVEL * rng.normal(size=true.shape)
    seen = dataclasses.replace(told, position=position)
    noise = dataclasses.replace(clean.shooting.noise, scale=np.full(true.shape[-1], LEVEL))
    shooting = dataclasses.replace(clean.shooting, segments=seen, noise=noise)
    return shooting, shooting.fit([((), ())], clean.nominal.starts)[0]


@pytest.mark.parametrize("step", [3e-4, 1e-3])
def test_rounding_once_more_leaves_about_what_rounding_has_left(clean, step: float) -> None:
    shooting, fit = recorded(clean, step)
    assert [rounding(run) for run in shooting.segments.runs] == pytest.approx([step] * len(shooting.segments.runs))
    excess = fit.chi2 - shooting.dof
    assert excess > 0.5 * shooting.dof
    assert excess == pytest.approx(left_by_rounding(shooting, fit), rel=0.6)
    assert left_by_rounding(shooting, dataclasses.replace(fit, design=None)) > 0.0
    assert f"multiples of {step:.2g} s" in rounded_clock(shooting, fit)


def test_what_is_missing_besides_is_not_the_clocks(clean) -> None:
    shooting, fit = recorded(clean, 2e-4)
    left = left_by_rounding(shooting, fit)
    assert left > 0.0
    for times, said in ((1.0, True), (5.0, False)):
        more = dataclasses.replace(fit, chi2=shooting.dof + times * left)
        assert bool(rounded_clock(shooting, more)) == said


def test_an_even_clock_and_an_exact_one_are_not_rounded(clean, bench) -> None:
    even, exact = recorded(clean, 1e-3, uneven=0.0), recorded(clean, 1e-9)
    for shooting, fit in (even, exact):
        assert left_by_rounding(shooting, fit) < 1e-3 * shooting.dof
    assert rounded_clock(bench.shooting, bench.nominal) == ""
