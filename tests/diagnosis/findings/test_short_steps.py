from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.diagnosis.against_a_stop import AT, DAMPING, STIFFNESS, struck_bench
from tests.diagnosis.conftest import Bench
from torch_activegp.diagnosis.findings.short_steps import numbers_of
from torch_activegp.diagnosis.shooting.fit import Fit
from torch_activegp.physics.stops import JointStop


@pytest.fixture(scope="module")
def struck() -> Bench:
    return struck_bench()


@pytest.fixture(autouse=True)
def _in_time(monkeypatch) -> None:
    """Fits of three runs end soon: they creep at the jump, and a tenth of the work is near enough."""
    monkeypatch.setattr("torch_activegp.diagnosis.findings.short_steps._WORK", 1e6)


def in_long_steps(bench: Bench) -> Fit:
    stop = next(e for e in bench.effects if isinstance(e, JointStop) and e.variant == "upper")
    return bench.shooting.fit([((stop,), (np.array([STIFFNESS, DAMPING, AT]),))], bench.nominal.starts)[0]


def test_the_numbers_of_a_stop_are_those_of_short_steps(struck: Bench) -> None:
    coarse = in_long_steps(struck)
    sharp, by, notes = numbers_of(struck.engine, struck.shooting, coarse, held=True)
    true = np.array([STIFFNESS, DAMPING, AT])
    before, after = (np.abs(fit.values[0] - true) / true for fit in (coarse, sharp))
    assert before[1] > 0.015
    assert (after[:2] < 0.3 * before[:2]).all()
    assert sharp.chi2 < 0.2 * coarse.chi2
    assert sharp.information.shape == (3, 3)
    assert by.engine.substeps == 16 * struck.engine.substeps
    assert notes == (
        "joint_stop at joint:hip: all parameters given here were fitted in steps of 0.31 ms, for where in a longer one "
        "something strikes is an accident. The corrected model, curves and what is said of stability have those that "
        "do the same in longer steps.",
    )


def test_nothing_changes_where_nothing_strikes(bench) -> None:
    smooth = bench.fit("viscous_friction", 0.05)
    assert numbers_of(bench.engine, bench.shooting, smooth, held=True) == (smooth, bench.shooting, ())


@pytest.mark.parametrize(("flattered", "afforded"), [(0.05, 6e5), (1.0, 10.0)])
def test_long_steps_stay_where_short_ones_do_worse_or_take_too_long(
    struck: Bench, monkeypatch, flattered: float, afforded: float
) -> None:
    """The first as by the steps of a simulator that made the recordings."""
    monkeypatch.setattr("torch_activegp.diagnosis.findings.short_steps._AFFORDED", afforded)
    coarse = in_long_steps(struck)
    coarse = dataclasses.replace(coarse, chi2=flattered * coarse.chi2)
    fit, by, notes = numbers_of(struck.engine, struck.shooting, coarse, held=False)
    assert fit is coarse
    assert by is struck.shooting
    assert notes == ()
