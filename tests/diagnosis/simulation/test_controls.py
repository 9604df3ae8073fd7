from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.controls import Controls, Inputs, added


def _at(control: Controls, interval: int, substep: int = 0, substeps: int = 1) -> np.ndarray:
    """Controls ``(N * S, nu)`` in one step of an interval."""
    return control(np.array([interval * substeps + substep]))[:, 0]


def test_nominal_controls_are_the_recorded_ones_held_over_each_interval(bench) -> None:
    control = Controls(bench.segments, [NOMINAL], 3, 1)
    recorded = bench.segments.take("control")
    for interval in (0, 7, bench.segments.intervals - 1):
        for substep in range(3):
            np.testing.assert_array_equal(_at(control, interval, substep, 3), recorded[:, interval])


def test_effects_act_on_their_own_candidate_in_the_order_of_the_chain(bench) -> None:
    gain, bias = bench.effect("actuator_gain", "actuator:drive"), bench.effect("actuator_bias", "actuator:drive")
    assert gain.order < bias.order
    both = Candidate((bias, gain), (np.array([0.3]), np.array([1.0])))
    alone = Candidate((gain,), (np.array([-0.5]),))
    control = _at(Controls(bench.segments, [both, NOMINAL, alone], 2, 1), 4, 1, 2).reshape(3, -1)
    recorded = bench.segments.take("control")[:, 4, 0]
    np.testing.assert_allclose(control, [2.0 * recorded + 0.3, recorded, 0.5 * recorded])


def test_the_past_of_a_simulation_has_the_clock_of_its_run_and_means_between_rows(bench) -> None:
    gain, delay = bench.effect("actuator_gain", "actuator:drive"), bench.effect("actuator_delay", "actuator:drive")
    late = Candidate((delay,), (np.array([0.005]),))  # half a row
    control = Controls(bench.segments, [NOMINAL, Candidate((gain,), (np.array([1.0]),)), late], 4, 1)
    size = bench.segments.size
    past = control.past(np.array([2, size + 2, 2 * size + 2, 0]))
    before = past.control(np.arange(4), 4)
    assert len(set(past.same[:3].tolist())) == 3
    assert past.same[3] == past.same[0]
    np.testing.assert_array_equal(past.control(np.array([2, 0]), 4), before[[2, 0]])
    run, first = bench.segments.run[2], bench.segments.first[2]
    recorded = bench.segments.runs[run].control
    expected = recorded[np.maximum(np.arange(first - 5, first), 0)]
    np.testing.assert_allclose(before[0], expected[1:])
    np.testing.assert_allclose(before[1], 2.0 * expected[1:])
    np.testing.assert_allclose(before[2], 0.5 * (expected[1:] + expected[:-1]))
    np.testing.assert_array_equal(
        before[3], np.repeat(bench.segments.runs[bench.segments.run[0]].control[:1], 4, axis=0)
    )
    for clock, one in zip(past.time, bench.segments.runs, strict=True):
        np.testing.assert_allclose(clock[: len(one)], one.time - one.time[0])


def test_a_delay_reaches_back_before_the_segment_and_holds_the_first_value_of_the_run(bench) -> None:
    delay = bench.effect("actuator_delay", "actuator:drive")
    control = Controls(bench.segments, [Candidate((delay,), (np.array([0.03]),))], 1, 1)
    for s, (number, first) in enumerate(zip(bench.segments.run, bench.segments.first, strict=True)):
        recorded = bench.segments.runs[number].control[:, 0]
        assert _at(control, 0)[s, 0] == pytest.approx(recorded[max(first - 3, 0)])
        assert _at(control, 5)[s, 0] == pytest.approx(recorded[max(first + 2, 0)])


def test_a_shove_is_added_in_its_interval_alone(bench) -> None:
    segments = bench.segments
    shove = np.zeros((segments.size, segments.intervals, 1))
    shove[2, 3] = 0.7
    control = Controls(segments, [NOMINAL, Candidate(shove=shove)], 1, 1)
    more = _at(control, 3).reshape(2, -1)
    np.testing.assert_allclose(more[1] - more[0], np.where(np.arange(segments.size) == 2, 0.7, 0.0))
    same = _at(control, 4).reshape(2, -1)
    np.testing.assert_array_equal(same[0], same[1])


def test_added_leaves_the_base_as_it_is() -> None:
    base = np.ones((2, 3, 1))
    out = added(base, [None, np.full((2, 3, 1), 2.0)])
    assert out.shape == (2, 2, 3, 1)
    assert (out[0] == 1.0).all() and (out[1] == 3.0).all() and (base == 1.0).all()


def test_late_inputs_are_the_mean_of_the_step_before_and_this_one(bench) -> None:
    segments = bench.segments
    control = Controls(segments, [NOMINAL], 2, 1)
    for s, (number, first) in enumerate(zip(segments.run, segments.first, strict=True)):
        recorded = segments.runs[number].control
        before = recorded[max(first - 1, 0)]
        late = control(np.arange(4), (-1, 0))[s]
        np.testing.assert_allclose(late[0], 0.5 * (before + recorded[first]))
        np.testing.assert_allclose(late[1:3], [recorded[first], 0.5 * (recorded[first] + recorded[first + 1])])


def test_a_step_over_several_rows_takes_the_mean_of_their_inputs(bench) -> None:
    segments = bench.segments
    inputs = Inputs(segments, [NOMINAL], Controls(segments, [NOMINAL], 1, 1), 1, stride=4)
    recorded = segments.take("control")
    controls, forces = inputs([(0, 4), (4, 8)])
    np.testing.assert_allclose(controls, np.stack([recorded[:, :4].mean(1), recorded[:, 4:8].mean(1)], axis=1))
    assert forces.shape == (segments.size, 1, forces.shape[2]) and not inputs.pushes
    late = Inputs(segments, [NOMINAL], Controls(segments, [NOMINAL], 1, 1), 1, stride=4, late=True)
    half = 0.5 * (recorded[:, :4].mean(1) + recorded[:, 4:8].mean(1))
    middle = recorded[:, 2:6].mean(1)
    np.testing.assert_allclose(late([(4, 8)])[0][:, 0], middle)
    assert np.abs(middle - half).max() < np.ptp(recorded)


def test_forces_come_late_with_the_controls_and_on_top_of_steady_ones(bench) -> None:
    segments = bench.segments
    push = np.zeros((segments.size, segments.intervals, 1))
    push[1, 3] = 2.0
    steady = np.full((segments.size, 1), 0.5)
    candidate = Candidate(force=push)
    inputs = Inputs(segments, [candidate], Controls(segments, [candidate], 1, 1), 1, late=True, steady=steady)
    _, forces = inputs([(k, k + 1) for k in range(6)])
    np.testing.assert_allclose(forces[1, :, 0], [0.5, 0.5, 0.5, 1.5, 1.5, 0.5])
    assert inputs.pushes
    shoved = Candidate(shove=push)
    late = Inputs(segments, [NOMINAL, shoved], Controls(segments, [NOMINAL, shoved], 1, 1), 1, late=True)
    controls = late([(k, k + 1) for k in range(6)])[0].reshape(2, segments.size, 6)
    np.testing.assert_allclose((controls[1] - controls[0])[1], [0.0, 0.0, 0.0, 1.0, 1.0, 0.0])
