from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.controls import Controls, added


def test_nominal_controls_are_the_recorded_ones_held_over_each_interval(bench) -> None:
    control = Controls(bench.segments, [NOMINAL], 3, 1)
    recorded = bench.segments.take("control")
    for interval in (0, 7, bench.segments.intervals - 1):
        for substep in range(3):
            np.testing.assert_array_equal(control(interval, substep), recorded[:, interval])


def test_effects_act_on_their_own_candidate_in_the_order_of_the_chain(bench) -> None:
    gain, bias = bench.effect("actuator_gain", "actuator:drive"), bench.effect("actuator_bias", "actuator:drive")
    assert gain.order < bias.order
    both = Candidate((bias, gain), (np.array([0.3]), np.array([1.0])))
    alone = Candidate((gain,), (np.array([-0.5]),))
    control = Controls(bench.segments, [both, NOMINAL, alone], 2, 1)(4, 1).reshape(3, -1)
    recorded = bench.segments.take("control")[:, 4, 0]
    np.testing.assert_allclose(control, [2.0 * recorded + 0.3, recorded, 0.5 * recorded])


def test_a_delay_reaches_back_before_the_segment_and_holds_the_first_value_of_the_run(bench) -> None:
    delay = bench.effect("actuator_delay", "actuator:drive")
    control = Controls(bench.segments, [Candidate((delay,), (np.array([0.03]),))], 1, 1)
    for s, (number, first) in enumerate(zip(bench.segments.run, bench.segments.first, strict=True)):
        recorded = bench.segments.runs[number].control[:, 0]
        assert control(0, 0)[s, 0] == pytest.approx(recorded[max(first - 3, 0)])
        assert control(5, 0)[s, 0] == pytest.approx(recorded[max(first + 2, 0)])


def test_a_shove_is_added_in_its_interval_alone(bench) -> None:
    segments = bench.segments
    shove = np.zeros((segments.size, segments.intervals, 1))
    shove[2, 3] = 0.7
    control = Controls(segments, [NOMINAL, Candidate(shove=shove)], 1, 1)
    more = control(3, 0).reshape(2, -1)
    np.testing.assert_allclose(more[1] - more[0], np.where(np.arange(segments.size) == 2, 0.7, 0.0))
    same = control(4, 0).reshape(2, -1)
    np.testing.assert_array_equal(same[0], same[1])


def test_added_leaves_the_base_as_it_is() -> None:
    base = np.ones((2, 3, 1))
    out = added(base, [None, np.full((2, 3, 1), 2.0)])
    assert out.shape == (2, 2, 3, 1)
    assert (out[0] == 1.0).all() and (out[1] == 3.0).all() and (base == 1.0).all()
