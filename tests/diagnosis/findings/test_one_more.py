from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.one_more import left_of_errors
from torch_activegp.diagnosis.inputs.segments import cut


@pytest.fixture(scope="module")
def wet(bench):
    return bench.fit("viscous_friction", 0.05)


def begin(bench, run) -> np.ndarray:
    return bench.engine.starts(cut([run], 1e9, 0.0))[0]


def test_a_recording_like_one_of_two_tells_as_much_as_that_one(bench, wet) -> None:
    run = bench.machine.fit[0]
    own = bench.shooting.pick(bench.segments.run == 0)
    again = own.fit([(wet.effects, wet.values)], wet.starts[bench.segments.run == 0])[0].information
    (left,) = left_of_errors(bench.shooting, wet, run, begin(bench, run))
    assert left == pytest.approx(np.sqrt(wet.information / (wet.information + again)).item(), rel=0.1)
    assert 0.6 < left < 0.9


def test_what_knew_little_gains_much_but_no_more_than_is_believed(bench, wet) -> None:
    run = bench.machine.fit[0]
    vague = dataclasses.replace(wet, information=1e-6 * wet.information)
    np.testing.assert_allclose(left_of_errors(bench.shooting, vague, run, begin(bench, run)), [0.1])


def test_a_recording_that_cannot_be_simulated_tells_nothing(bench, wet) -> None:
    run = bench.machine.fit[0]
    np.testing.assert_allclose(left_of_errors(bench.shooting, wet, run, np.full(2, np.nan)), [1.0])


def test_a_correction_of_the_likelihood_is_of_other_rows(bench, wet) -> None:
    run = bench.machine.fit[0]
    corrected = dataclasses.replace(bench.shooting, offset=np.zeros_like(bench.segments.position))
    both = [left_of_errors(shooting, wet, run, begin(bench, run)) for shooting in (bench.shooting, corrected)]
    np.testing.assert_array_equal(*both)
