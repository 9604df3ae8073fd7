from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics.stops import JointStop, LowerJointStop


@pytest.mark.parametrize(("kind", "side"), [(JointStop, 1.0), (LowerJointStop, -1.0)])
def test_a_stop_pushes_back_past_its_position_and_never_pulls(bench: Any, kind: Any, side: float) -> None:
    effect, values = kind.at(bench.shoulder, bench.model), [60.0, 0.5, 0.1]
    position = np.linspace(-1.5, 1.5, 301)
    force = effect.force(position, 0.0 * position, values)
    assert (side * force <= 0.0).all()
    assert side * force.sum() < 0.0
    assert (force[side * position <= values[2]] == 0.0).all()
    assert (effect.force(position, 0.0 * position - side * 1e3, values) == 0.0).all()  # leaving


@pytest.mark.parametrize("kind", [JointStop, LowerJointStop])
def test_a_joint_is_not_always_behind_its_stop(bench: Any, kind: Any) -> None:
    """Its damper would be a friction that differs between the directions."""
    effect, (low, high) = kind.at(bench.shoulder, bench.model), bench.shoulder.position
    stop = effect.parameters[2]
    ends = (low, high) if kind.side > 0 else (-high, -low)
    assert stop.high == pytest.approx(ends[1] + 0.05 * (high - low))  # an encoder may read too little
    assert effect.end == ends[1]
    assert stop.low == pytest.approx(ends[1] - 0.6 * (high - low))
    assert all(stop.low < seed[2] < stop.high for seed in effect.seeds)


@pytest.mark.parametrize("kind", [JointStop, LowerJointStop])
def test_a_stop_lies_before_where_the_model_touches_something(bench: Any, kind: Any) -> None:
    low, high = bench.shoulder.position
    width, free = high - low, kind.side * (high if kind.side > 0 else low)
    for into, shifted in ((0.2, True), (0.9, False)):  # behind the latter there is no room for another
        end = kind.side * (free - into * width)
        walls = (-np.inf, end) if kind.side > 0 else (end, np.inf)
        effect = kind.at(dataclasses.replace(bench.shoulder, free=walls), bench.model)
        stop = effect.parameters[2]
        assert stop.high == pytest.approx(free - 0.23 * width if shifted else free + 0.05 * width)
        assert stop.low == pytest.approx(free - 0.6 * width)
        assert all(stop.low < seed[2] < stop.high for seed in effect.seeds)


@pytest.mark.parametrize(("kind", "within"), [(JointStop, (0.1, np.inf)), (LowerJointStop, (-np.inf, -0.1))])
def test_it_acts_past_its_position_alone(bench: Any, kind: Any, within: Any) -> None:
    acting = kind.at(bench.shoulder, bench.model).acts(np.array([60.0, 0.5, 0.1]))
    assert acting == ("shoulder", "qpos.shoulder", (within,))


def test_two_stops_fit_in_one_file_if_they_are_alike(bench: Any) -> None:
    upper, lower = JointStop.at(bench.shoulder, bench.model), LowerJointStop.at(bench.shoulder, bench.model)
    spec = bench.spec
    assert upper.write(spec, np.array([60.0, 0.5, 0.4]))
    assert not lower.write(spec.copy(), np.array([30.0, 0.5, 0.2]))
    assert lower.write(spec, np.array([60.0, 0.5, 0.2]))
    np.testing.assert_allclose(spec.compile().jnt_range[0], [-0.2, 0.4])
    limited = mujoco.MjSpec.from_string(bench.xml.replace('damping="0.05"', 'damping="0.05" range="-2 2"'))
    assert not upper.write(limited, np.array([60.0, 0.5, 0.4]))


def test_a_stop_is_described_by_where_it_is_on_the_joint(bench: Any) -> None:
    stop = LowerJointStop.at(bench.shoulder, bench.model).describe(np.array([60.0, 0.5, 0.2]))
    assert stop == {"position": -0.2, "stiffness": 60.0, "damping": 0.5}


def test_stops_are_looked_for_where_they_were_hardly_touched(bench: Any) -> None:
    place = dataclasses.replace(bench.shoulder, position=(-0.5, 1.5))
    for kind, end in ((JointStop, 1.5), (LowerJointStop, 0.5)):
        places = kind.at(place, bench.model).seeds[:, 2]
        assert places.max() == pytest.approx(end - 0.0024 * 2.0)
        assert np.ptp(places) > 0.8


@pytest.mark.parametrize("kind", [JointStop, LowerJointStop])
def test_a_soft_first_guess_comes_with_a_stop_that_ends_the_motion_on_the_way_that_is_left(
    bench: Any, kind: Any
) -> None:
    stop = kind.at(bench.shoulder, bench.model)
    place = stop.end - 0.01
    *critical, (stiffness, damping, there) = stop.starts_beside(np.array([1.0, 0.1, place]))
    assert len(critical) == 2
    assert there == place
    assert 0.5 * stiffness * 0.01**2 == pytest.approx(0.5 * stop.inertia * bench.shoulder.speed**2)  # its energy
    assert damping == pytest.approx(0.1 * 2.0 * np.sqrt(stiffness * stop.inertia))
    assert len(stop.starts_beside(np.array([0.2 * stiffness, 0.1, place]))) == 2  # hard itself
    (hard,) = stop.starts_beside(np.array([0.0, 0.1, place]))  # no damping is critical of what does not push back
    assert hard[0] == pytest.approx(stiffness)


@pytest.mark.parametrize("kind", [JointStop, LowerJointStop])
def test_a_stop_further_in_takes_the_same_force_at_the_end(bench: Any, kind: Any) -> None:
    stop = kind.at(bench.shoulder, bench.model)
    values, width = np.array([100.0, 3.0, stop.end - 0.1]), np.ptp(bench.shoulder.position)
    for further, share in zip(stop.further_in(values), (0.01, 0.02), strict=True):
        assert further[2] == pytest.approx(values[2] - share * width)
        assert further[0] * (stop.end - further[2]) == pytest.approx(10.0)
        assert further[1] / np.sqrt(further[0]) == pytest.approx(0.3)  # as much of the critical damping
    lowest = np.array([100.0, 3.0, stop.parameters[2].low + 0.015 * width])
    assert len(stop.further_in(lowest)) == 1
    for place in (stop.end, stop.end + 0.03 * width):  # hardly touched, or read short of it
        near, far = stop.further_in(np.array([100.0, 3.0, place]))
        assert (near[0], far[0]) == pytest.approx((50.0, 100.0 / 3.0))
        assert near[2] == pytest.approx(stop.end - 0.02 * width)
    assert stop.further_in(np.array([0.0, 0.0, stop.end - 0.1])) == []


@pytest.mark.parametrize("kind", [JointStop, LowerJointStop])
def test_a_stop_as_hard_as_may_be_ends_the_motion_where_it_ended(bench: Any, kind: Any) -> None:
    stop = kind.at(bench.shoulder, bench.model)
    values = np.array([100.0, 3.0, stop.end - 0.1])
    others = stop.as_hard(values)
    assert [other[0] for other in others] == pytest.approx([20.0, 500.0, 2500.0, 12500.0])
    for other in others:
        assert other[0] * (stop.end - other[2]) ** 2 == pytest.approx(1.0)  # takes up as much energy
        assert other[1] / np.sqrt(other[0]) == pytest.approx(0.3)
    deep = np.array([100.0, 3.0, stop.parameters[2].low + 1e-3])
    assert len(stop.as_hard(deep)) == 3  # a softer one would begin too early


def test_a_stop_springs_back(bench: Any) -> None:
    stop = JointStop.at(bench.shoulder, bench.model)
    critical = 2.0 * np.sqrt(100.0 * stop.inertia)
    ends = [np.array(values) for values in ([100.0, critical, 0.5], [100.0, 11.0 * critical, 0.5], [0.0, 40.0, 0.5])]
    assert [stop.plausible(values) for values in ends] == [True, False, False]
    assert stop.plausible(np.array([100.0, 0.0, 0.5]))
