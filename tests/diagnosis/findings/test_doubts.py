from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis import diagnose
from torch_activegp.diagnosis.findings.doubts import DOUBTED_LEFT, MUCH_LEFT, NO_SKILL, reservation, straight_lines

DOUBT = ("Column `ctrl.drive`: ...",)


@pytest.fixture(scope="module")
def quiet(bench):
    """The likelihood of a recorder with a thousandth of the noise, by which straight lines leave much."""
    noise = dataclasses.replace(bench.shooting.noise, scale=1e-3 * bench.shooting.noise.scale)
    return dataclasses.replace(bench.shooting, noise=noise)


def test_straight_lines_are_fitted_to_each_joint_of_each_segment(quiet) -> None:
    segments, left = quiet.segments, 0.0
    for position, counts, dt in zip(segments.position, segments.counts, segments.dt, strict=True):
        time = np.concatenate([[0.0], np.cumsum(dt)])[counts]
        for channel, scale in zip(position[counts].T, quiet.noise.scale, strict=True):
            off = channel - np.polyval(np.polyfit(time, channel, 1), time)
            left += float((off**2).sum()) / scale**2
    assert straight_lines(quiet) == pytest.approx(left, rel=1e-6)
    corrected = dataclasses.replace(quiet, offset=segments.position)  # which is a simulation's, and not theirs
    assert straight_lines(corrected) == pytest.approx(left, rel=1e-6)


@pytest.mark.parametrize(("skill", "given"), [(0.9, True), (1.1, False)])
def test_names_that_leave_as_much_as_straight_lines_are_not_given(quiet, bench, skill: float, given: bool) -> None:
    """A nominal that runs away is explained by what takes its forces away."""
    lines = straight_lines(quiet)
    assert NO_SKILL * lines > 2 * MUCH_LEFT * quiet.dof
    why = reservation(quiet, dataclasses.replace(bench.nominal, chi2=skill * NO_SKILL * lines), ())
    assert (why is None) == given
    assert given or "straight lines through each 0.48 s" in str(why)


@pytest.mark.parametrize(("part", "given"), [(0.0012, True), (0.18, False)])
def test_names_as_those_of_real_drives_stand_and_those_of_a_command_in_degrees_do_not(
    quiet, bench, part: float, given: bool
) -> None:
    lines = straight_lines(quiet)
    loud = dataclasses.replace(quiet, noise=dataclasses.replace(quiet.noise, scale=1e-2 * quiet.noise.scale))
    fit = dataclasses.replace(bench.nominal, chi2=part * 1e4 * lines)
    assert fit.chi2 > MUCH_LEFT * loud.dof
    assert (reservation(loud, fit, ()) is None) is given


def test_names_that_leave_much_of_doubtful_recordings_are_not_given(record, model, quiet, bench) -> None:
    """A motor's controls that are recorded a hundred times too large: no name may stand for that."""
    assert DOUBTED_LEFT < MUCH_LEFT
    for doubts, undriven, bar, why in (
        (DOUBT, (), DOUBTED_LEFT, "leave 2.2 times the noise (chi2 per dof), and a column is in doubt"),
        ((), DOUBT, MUCH_LEFT, "leave 110 times the noise (chi2 per dof), and no control is recorded"),
    ):
        left = [dataclasses.replace(bench.nominal, chi2=times * bar * quiet.dof) for times in (0.9, 1.1)]
        assert [reservation(quiet, fit, doubts, undriven) for fit in left] == [None, why]
        assert reservation(quiet, left[1], ()) is None
    runs = []
    for seed in range(4):
        run = record("none", seed)
        runs.append(record("none", seed, ctrl__drive=100.0 * run["ctrl.drive"].numpy()))
    found = diagnose(model, runs, nthread=1)
    assert found.verdict == "unknown"
    assert "Check the recordings first: Column `ctrl.drive`" in found.sentence
