from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.findings.locate import Region, entries, locate, somewhere
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.physics.effect import Acting


def region(joint: str, force: list[float], over: str = "qpos.a", gain: float = 100.0, adjusted: float = 1e-9) -> Region:
    n = len(force)
    return Region(
        joint, over, np.arange(n + 1.0), np.array(force), np.full(n, 0.1), np.full(n, 50.0), gain, adjusted, adjusted
    )


def test_the_residual_force_is_the_friction_that_the_model_lacks(bench) -> None:
    found = {r.over: r for r in locate(bench.shooting, bench.nominal)}
    assert set(found) == {"qpos.hip", "qvel.hip", "ctrl.drive"}
    speed = found["qvel.hip"]
    middle = 0.5 * (speed.edges[1:] + speed.edges[:-1])
    known = speed.spread < 0.02
    assert known.sum() >= 3
    np.testing.assert_allclose(speed.force[known], -bench.viscous * middle[known], atol=0.05)
    assert speed.adjusted < 1e-6
    assert speed.count.sum() == bench.segments.size * bench.segments.intervals


def test_noise_alone_is_nowhere(clean) -> None:
    found = locate(clean.shooting, clean.nominal)
    assert min(r.adjusted for r in found) > 0.01
    assert entries([r for r in found if r.adjusted > 0.05], 0.0) == []


def test_the_region_of_a_bump_is_the_shortest_with_most_of_its_energy() -> None:
    assert region("a", [0, 0, 0, 5, 4, 0, 0, 0, 0, 0]).interval == (3.0, 5.0)
    assert region("a", [1.0] * 10).interval is None
    assert region("a", [0.0] * 10).interval is None


def test_every_joint_with_something_gets_an_entry_by_share() -> None:
    bump, flat = [0, 0, 0, 5, 4, 0, 0, 0, 0, 0], [1.0] * 10
    found = entries(
        [
            region("a", flat, "qvel.a", 210.0),
            region("a", bump, "qpos.a", 180.0),
            region("b", flat, "qvel.b", 510.0),
            region("c", flat, "qvel.c", 900.0, adjusted=0.2),
        ],
        1000.0,
    )
    assert [entry["target"] for entry in found] == ["joint:b", "joint:a"]
    assert [entry["share"] for entry in found] == pytest.approx([0.5, 0.2])
    assert found[0]["region"] == {"qvel.b": [0.0, 10.0]}
    assert found[1]["region"] == {"qpos.a": [3.0, 5.0]}


def test_what_is_named_says_where_it_acts(bench) -> None:
    stops = [effect for effect in bench.effects if effect.name == "joint_stop"]
    slip, clip = bench.effect("stribeck_friction"), bench.effect("actuator_saturation", "actuator:drive")
    assert somewhere([(bench.effect("viscous_friction"), np.array([0.1]))]) == {}
    ends = {e.variant: somewhere([(e, np.array([9.0, 1.0, 0.7])), (slip, np.ones(3))])["hip"] for e in stops}
    assert {variant: acting.within for variant, acting in ends.items()} == {
        "upper": ((0.7, np.inf),),
        "lower": ((-np.inf, -0.7),),
    }
    slow = somewhere([(slip, np.array([1.0, 1.0, 0.1]))])["hip"]
    assert slow.over == "qvel.hip"
    np.testing.assert_allclose(slow.within, [(-0.1517, 0.1517)], atol=1e-4)
    past = somewhere([(clip, np.array([0.4]))])["hip"]
    assert past == ("hip", "ctrl.drive", ((0.4, np.inf), (-np.inf, -0.4)))


def test_of_joints_that_each_explain_all_the_one_that_would_explain_more_comes_first() -> None:
    found = entries([region("a", [1.0] * 10, gain=500.0), region("b", [1.0] * 10, gain=600.0)], 100.0)
    assert [(entry["target"], entry["share"]) for entry in found] == [("joint:b", 1.0), ("joint:a", 1.0)]


def test_the_region_of_a_named_effect_is_where_it_acts_as_far_as_that_was_seen(bench) -> None:
    found = [region("hip", [1.0] * 10, "qvel.hip", 500.0), region("hip", [1.0] * 10, "qpos.hip", 100.0)]
    (entry,) = entries(found, 1000.0, {"hip": Acting("hip", "qpos.hip", ((8.5, np.inf),))})
    assert entry["region"] == {"qpos.hip": [8.5, 10.0]}
    assert entry["share"] == pytest.approx(0.49)
    for over, within in (("qpos.hip", (10.5, np.inf)), ("ctrl.drive", (-1.0, 1.0))):  # past all; seen nowhere
        (entry,) = entries(found, 1000.0, {"hip": Acting("hip", over, (within,))})
        assert list(entry["region"]) == ["qvel.hip"]


def test_a_named_effect_has_a_place_though_no_bins_show_it() -> None:
    """A stop that was struck once in six seconds."""
    found = [region("hip", [1.0] * 10, "qpos.hip", 12.0, 0.4), region("hip", [1.0] * 10, "qvel.hip", 20.0, 0.3)]
    (entry,) = entries(found, 1000.0, {"hip": Acting("hip", "qpos.hip", ((8.5, np.inf),))})
    assert entry == {
        "target": "joint:hip",
        "share": pytest.approx(0.002),
        "region": {"qpos.hip": [8.5, 10.0]},
        "q_value": 0.4,
    }
    assert entries(found, 1000.0, {"hip": Acting("hip", "qpos.hip", ((10.5, np.inf),))}) == []
    assert entries(found, 1000.0, {"knee": Acting("knee", "qpos.knee", ((8.5, np.inf),))}) == []


def test_what_lies_beyond_the_middle_of_the_data_belongs_to_the_outer_bins() -> None:
    """A limit of a drive, or a stop, acts on the last hundredth of the rows, where a histogram has no bin."""
    wide = dataclasses.replace(region("hip", [0, 0, 0, 0, 0, 0, 0, 0, 4.0, 5.0], gain=500.0), reach=(-2.0, 14.0))
    assert wide.interval == (8.0, 14.0)
    assert wide.energy(11.5, 14.0) == pytest.approx(0.5 * 50.0 * 25.0)
    assert wide.energy(-np.inf, np.inf) == pytest.approx(50.0 * (16.0 + 25.0))
    (entry,) = entries([wide], 1000.0, {"hip": Acting("hip", "qpos.a", ((12.0, np.inf),))})
    assert entry["region"] == {"qpos.a": [12.0, 14.0]}
    flat = dataclasses.replace(region("a", [1.0] * 10), reach=(-2.0, 14.0))
    assert entries([flat], 1000.0)[0]["region"] == {"qpos.a": [-2.0, 14.0]}


def test_the_reach_of_a_variable_is_all_that_was_recorded(bench) -> None:
    """A simulation that flies off in one segment says nothing of it."""
    starts = bench.nominal.starts.copy()
    starts[1, 1] += 40.0
    found = {r.over: r for r in locate(bench.shooting, dataclasses.replace(bench.nominal, starts=starts))}
    columns = (("qpos.hip", "smooth"), ("qvel.hip", "velocity"), ("ctrl.drive", "control"))
    for over, name in columns:
        values = bench.segments.take(name)
        assert found[over].reach == (values.min(), values.max())


def test_two_sides_are_two_entries_and_the_second_comes_last() -> None:
    found = [
        region("hip", [3.0, 1, 1, 1, 1, 1, 1, 1, 1, 1], "ctrl.drive", 510.0),
        region("knee", [1.0] * 10, "qvel.knee", 210.0),
    ]
    sides = Acting("hip", "ctrl.drive", ((9.0, np.inf), (-np.inf, 1.0)))
    listed = entries(found, 1000.0, {"hip": sides})
    assert [entry["region"] for entry in listed] == [
        {"ctrl.drive": [9.0, 10.0]},
        {"qvel.knee": [0.0, 10.0]},
        {"ctrl.drive": [0.0, 1.0]},
    ]
    assert [entry["share"] for entry in listed] == pytest.approx([0.05, 0.2, 0.45])
    (first, _) = entries(found, 1000.0, {"hip": Acting("hip", "ctrl.drive", ((9.0, np.inf), (-np.inf, -1.0)))})
    assert first["share"] == pytest.approx(0.5)  # the other side was never seen


def test_a_bump_in_the_truth_is_located(diagnosed) -> None:
    (entry, *_) = diagnosed("bump").details["location"]
    low, high = entry["region"]["qpos.hip"]
    assert entry["target"] == "joint:hip"
    assert 0.1 < low < 0.4 < high < 0.8


def test_another_fit_may_be_seen_in_the_same_bins(bench) -> None:
    before = locate(bench.shooting, bench.nominal)
    starts = bench.nominal.starts.copy()
    starts[:, 1] *= 1.1
    other = dataclasses.replace(bench.nominal, starts=starts)
    own, same = (locate(bench.shooting, other, *bins) for bins in ((), (before,)))
    assert any(not np.array_equal(a.edges, b.edges) for a, b in zip(own, before, strict=True))
    for a, b in zip(same, before, strict=True):
        np.testing.assert_array_equal(a.edges, b.edges)


@pytest.mark.parametrize("first", [True, False])
def test_an_actuator_without_input_is_no_variable(bench, first: bool) -> None:
    loss = '<dcmotor name="loss" joint="hip" motorconst="0 0" resistance="1" input="none"/>'
    drive = '<motor name="drive" joint="hip"/>'
    model = mujoco.MjModel.from_xml_string(bench.xml.replace(drive, loss + drive if first else drive + loss))
    engine = Engine(model, bench.engine.channels, bench.engine.substeps, 1)
    found = locate(dataclasses.replace(bench.shooting, engine=engine), bench.nominal)
    assert {region.over for region in found} == {"qpos.hip", "qvel.hip", "ctrl.drive"}
