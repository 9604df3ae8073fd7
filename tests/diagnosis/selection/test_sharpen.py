from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.conftest import INERTIA, NOISE, RATE, XML, Bench, assemble
from torch_activegp.data import Recording
from torch_activegp.diagnosis.selection.compared import Selection
from torch_activegp.diagnosis.selection.sharpen import sharpened
from torch_activegp.diagnosis.shooting.score import Score
from torch_activegp.physics.stops import JointStop

AT, STIFFNESS, DAMPING = 0.3, 60.0, 1.5


def strikes(seed: int) -> Recording:
    """The pendulum of the bench against a stop, by the semi-implicit Euler scheme in steps of 20 us."""
    rng, h = np.random.default_rng(seed), 2e-5
    time = np.arange(4 * RATE + 1) / RATE
    control = 2.0 * np.sin(2 * np.pi * rng.uniform(0.6, 0.9) * time + rng.uniform(0, 2 * np.pi))
    q, v, angles = 0.0, 0.0, []
    for u in control:
        angles.append(q)
        for _ in range(round(1 / RATE / h)):
            stop = max(STIFFNESS * (q - AT) + DAMPING * v, 0.0) if q > AT else 0.0
            v += h * (u - 9.81 * 0.5 * np.sin(q) - stop) / INERTIA
            q += h * v
    assert max(angles) > AT + 0.02
    noisy = np.array(angles) + 0.1 * NOISE * rng.normal(size=len(time))
    return Recording.from_columns(f"run{seed}", {"time": time, "qpos.hip": noisy, "ctrl.drive": control})


@pytest.fixture(scope="module")
def struck() -> Bench:
    made = assemble("stop", XML, [strikes(seed) for seed in range(3)], strikes(9))
    noise = dataclasses.replace(made.shooting.noise, scale=0.1 * made.shooting.noise.scale)
    return dataclasses.replace(made, shooting=dataclasses.replace(made.shooting, noise=noise))


@pytest.fixture(autouse=True)
def _in_time(monkeypatch) -> None:
    """Fits of three runs end soon: they creep at the jump, and a tenth of the work is near enough."""
    monkeypatch.setattr("torch_activegp.diagnosis.selection.sharpen._WORK", 1e6)


def of(bench: Bench) -> Selection:
    stop = next(e for e in bench.effects if isinstance(e, JointStop) and e.variant == "upper")
    first = (stop,), (np.array([STIFFNESS, DAMPING, AT]),)
    fit = bench.shooting.fit([first], bench.nominal.starts)[0]
    return Selection(bench.nominal, [bench.nominal, fit], Score(bench.shooting.samples, 60, 1.0))


def test_the_numbers_of_a_stop_are_those_of_short_steps(struck: Bench) -> None:
    selection = of(struck)
    coarse = selection.best
    shooting = sharpened(struck.engine, struck.shooting, selection)
    sharp = selection.best
    true = np.array([STIFFNESS, DAMPING, AT])
    before, after = (np.abs(fit.values[0] - true) / true for fit in (coarse, sharp))
    assert before[1] > 0.015
    assert (after[:2] < 0.3 * before[:2]).all()
    assert sharp.chi2 < coarse.chi2
    assert len(selection.fits) == 2
    # the likelihood is the coarse one, with which the best set leaves what it leaves in short steps
    assert shooting.engine is struck.shooting.engine
    left = (shooting.residual_of(sharp) ** 2).sum()
    assert left == pytest.approx(sharp.chi2, rel=1e-6)


def test_nothing_changes_where_nothing_strikes_or_short_steps_do_worse(struck: Bench, bench, monkeypatch) -> None:
    smooth = Selection(bench.nominal, [bench.fit("viscous_friction", 0.05)], Score(bench.shooting.samples, 60, 1.0))
    known = list(smooth.fits)
    assert sharpened(bench.engine, bench.shooting, smooth) is bench.shooting
    assert smooth.fits == known

    selection = of(struck)
    flattered = dataclasses.replace(selection.best, chi2=0.05 * selection.best.chi2)  # as by the steps of a simulator
    selection.fits = [selection.nominal, flattered]
    assert sharpened(struck.engine, struck.shooting, selection) is struck.shooting
    assert selection.best is flattered

    monkeypatch.setattr("torch_activegp.diagnosis.selection.sharpen._AFFORDED", 10.0)
    selection = of(struck)
    known = list(selection.fits)
    assert sharpened(struck.engine, struck.shooting, selection) is struck.shooting
    assert selection.fits == known


def test_rivals_are_fitted_in_the_same_steps(struck: Bench) -> None:
    selection = of(struck)
    selection.score = dataclasses.replace(selection.score, material=0.0)
    best = selection.best
    wider = (*best.effects, struck.effect("viscous_friction")), (*best.values, np.zeros(1))
    rival = struck.shooting.fit([wider], best.starts)[0]
    rival = dataclasses.replace(rival, chi2=best.chi2)  # which costs one name more
    far = dataclasses.replace(rival, effects=rival.effects[::-1], values=rival.values[::-1], chi2=best.chi2 + 1e4)
    selection.fits += [rival]
    sharpened(struck.engine, struck.shooting, selection)
    assert selection.fits[0] is selection.nominal
    assert selection.fits[2].effects == rival.effects
    assert selection.fits[2].chi2 == pytest.approx(selection.best.chi2, rel=0.05)
    assert rival.chi2 > 10.0 * selection.best.chi2

    selection.fits = [selection.nominal, best, far]
    sharpened(struck.engine, struck.shooting, selection)
    assert selection.fits[2] is far
