from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.rounded_clock import left_beside_rounding, rounded_clock
from torch_activegp.diagnosis.inputs.segments import lay
from torch_activegp.diagnosis.simulation.candidate import NOMINAL

LEVEL = 1e-4


def recorded(clean, *steps: float, uneven: float = 0.1, seed: int = 0):
    """The likelihood and fit of a perfect model by an uneven clock whose times were rounded to a step for each run."""
    rng, segments = np.random.default_rng(seed), clean.segments
    each = [*steps] if len(steps) == len(segments.runs) else [*steps] * len(segments.runs)
    clocks = [run.time + uneven * run.dt.mean() * rng.uniform(-1.0, 1.0, len(run.time)) for run in segments.runs]
    rounded = [np.round(clock / step) * step for clock, step in zip(clocks, each, strict=True)]
    pieces = [*zip(segments.run, segments.first, *segments.scored.T, strict=True)]
    exact, told = (
        lay([dataclasses.replace(r, time=t) for r, t in zip(segments.runs, times, strict=True)], pieces)
        for times in (clocks, rounded)
    )
    true = clean.engine.predict(exact, clean.nominal.starts[None], [NOMINAL])[0]
    position = true + LEVEL * rng.normal(size=true.shape)
    noise = dataclasses.replace(clean.shooting.noise, scale=np.full(true.shape[-1], LEVEL))
    shooting = dataclasses.replace(clean.shooting, segments=dataclasses.replace(told, position=position), noise=noise)
    return shooting, shooting.fit([((), ())], clean.nominal.starts)[0]


@pytest.mark.parametrize("step", [3e-4, 1e-3])
@pytest.mark.parametrize("seed", [0, 1])
def test_beside_what_rounding_may_have_left_is_noise(clean, step: float, seed: int) -> None:
    shooting, fit = recorded(clean, step, seed=seed)
    left = left_beside_rounding(shooting, fit)
    assert fit.chi2 > 2.0 * shooting.dof
    assert left.sum() == pytest.approx(shooting.dof, rel=0.25)
    assert left_beside_rounding(shooting, dataclasses.replace(fit, design=None)) == pytest.approx(left, rel=0.05)
    said = rounded_clock(shooting, fit)
    assert f"multiples of {step:.2g} s" in said
    assert f"the {fit.chi2 / shooting.dof:.3g} times the noise" in said


def test_each_run_has_a_clock_of_its_own(clean) -> None:
    shooting, fit = recorded(clean, 1e-9, 1e-3)
    first, left = shooting.segments.run == 0, left_beside_rounding(shooting, fit)
    assert left[first] == pytest.approx(fit.per_segment[first])
    assert (left[~first] < 0.5 * fit.per_segment[~first]).all()
    assert "multiples of 0.001 s" in rounded_clock(shooting, fit)


def test_a_failed_simulation_is_no_excuse(clean) -> None:
    shooting, fit = recorded(clean, 1e-3)
    lost = fit.starts.copy()
    lost[0] = np.nan
    left = left_beside_rounding(shooting, dataclasses.replace(fit, starts=lost))
    assert left[0] == fit.per_segment[0]
    assert np.isfinite(left).all()


@pytest.mark.parametrize(("size", "said"), [(0.0, True), (10.0, False)])
def test_what_acts_in_one_place_besides_is_not_the_clocks(clean, size: float, said: bool) -> None:
    """A slow error of so many times the noise in one of the segments, though rounding has left more in others."""
    shooting, fit = recorded(clean, 3e-4)
    position = shooting.segments.position.copy()
    position[1] += size * LEVEL * np.sin(2 * np.pi * np.linspace(0.0, 3.0, position.shape[1]))[:, None]
    shooting = dataclasses.replace(shooting, segments=dataclasses.replace(shooting.segments, position=position))
    assert bool(rounded_clock(shooting, shooting.fit([((), ())], fit.starts)[0])) == said


@pytest.mark.parametrize("step", [1e-4, 3e-4])
def test_physics_that_is_missing_is_not_the_clocks(bench, step: float) -> None:
    """A friction, though times were rounded too."""
    shooting, _ = recorded(bench, step)
    missing = (
        shooting.segments.position
        + bench.segments.position
        - bench.engine.predict(bench.segments, bench.nominal.starts[None], [NOMINAL])[0]
    )
    shooting = dataclasses.replace(shooting, segments=dataclasses.replace(shooting.segments, position=missing))
    fit = shooting.fit([((), ())], bench.nominal.starts)[0]
    assert left_beside_rounding(shooting, fit).sum() < fit.chi2
    assert rounded_clock(shooting, fit) == ""


def test_even_clocks_exact_ones_and_coarse_ticks_are_not_rounded(clean) -> None:
    even, exact, ticks = recorded(clean, 1e-3, uneven=0.0), recorded(clean, 1e-9), recorded(clean, 4e-3, uneven=0.5)
    for shooting, fit in (even, exact, ticks):
        assert left_beside_rounding(shooting, fit) is fit.per_segment
        less = dataclasses.replace(fit, per_segment=0.9 * fit.per_segment, chi2=0.9 * shooting.dof)
        assert rounded_clock(shooting, less) == ""
