from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.findings.evidence import laws, map_region, map_time
from torch_activegp.diagnosis.findings.locate import locate


@pytest.fixture(scope="module")
def damped(bench):
    return bench.fit("viscous_friction", 0.05)


def test_the_map_over_time_holds_chi2_per_sample_of_every_segment(bench, damped) -> None:
    entries = map_time(bench.shooting, bench.nominal, damped)
    assert [entry["run"] for entry in entries] == ["run0", "run1"]
    assert sum(len(entry["time"]) for entry in entries) == bench.segments.size
    counts = bench.segments.counts.sum(axis=1)
    own = bench.segments.run == 1
    np.testing.assert_allclose(entries[1]["before"], bench.nominal.per_segment[own] / counts[own])
    assert np.mean(entries[1]["after"]) == pytest.approx(1.0, abs=0.3)
    assert np.mean(entries[1]["before"]) > 3.0
    assert entries[0]["time"] == sorted(entries[0]["time"])
    long = np.diff(bench.segments.scored, axis=1)[own, 0] * 0.01
    np.testing.assert_allclose(entries[1]["seconds"], long, rtol=0.01)


def test_the_map_over_regions_shows_the_force_gone(bench, damped) -> None:
    before, after = locate(bench.shooting, bench.nominal), locate(bench.shooting, damped)
    entries = {entry["over"]: entry for entry in map_region(before, after)}
    speed = entries["qvel.hip"]
    assert speed["channel"] == "joint:hip"
    assert len(speed["edges"]) == len(speed["before"]) + 1 == len(speed["count"]) + 1
    assert np.mean(speed["before"]) > 20.0 > 3.0 > np.mean(speed["after"])


@pytest.mark.parametrize(
    ("law", "over"),
    [
        ("coulomb_friction", "qvel"),
        ("stribeck_friction", "qvel"),
        ("linear_spring", "qpos"),
        ("cogging", "qpos"),
        ("constant_force", "qpos"),
        ("joint_stop", "qpos"),
    ],
)
def test_a_law_is_drawn_over_what_it_depends_on(bench, law: str, over: str) -> None:
    effect = bench.effect(law)
    fit = dataclasses.replace(bench.nominal, effects=(effect,), values=(effect.seeds[-1],))
    (drawn,) = laws(bench.engine.channels, locate(bench.shooting, bench.nominal), fit, fit.effects)
    assert drawn["over"] == f"{over}.hip"


def test_the_law_runs_through_the_residual_force(bench, damped) -> None:
    left = locate(bench.shooting, damped)
    (law,) = laws(bench.engine.channels, left, damped, damped.effects)
    assert (law["name"], law["target"], law["over"]) == ("viscous_friction", "joint:hip", "qvel.hip")
    assert (law["unit_x"], law["unit_y"]) == ("rad/s", "N m")
    np.testing.assert_allclose(law["law_y"], -damped.values[0][0] * np.array(law["law_x"]))
    away = (np.interp(law["x"], law["law_x"], law["law_y"]) - law["force"]) / law["force_sd"]
    assert 0.5 < np.sqrt(np.mean(away**2)) < 2.0
    assert np.ptp(law["force"]) > 0.5 * np.ptp(law["law_y"])


def test_a_law_of_the_wrong_size_shows_the_force_that_is_there(bench, damped) -> None:
    """Half the damping leaves the other half in the residual: the points stay where they are, the line does not."""
    half = dataclasses.replace(damped, values=(0.5 * damped.values[0],))
    right, wrong = (
        laws(bench.engine.channels, locate(bench.shooting, fit), fit, fit.effects)[0] for fit in (damped, half)
    )
    moved = (np.array(wrong["force"]) - right["force"]) / np.array(right["force_sd"])
    assert np.sqrt(np.mean(moved**2)) < 1.0
    apart = (np.array(wrong["force"]) - np.interp(wrong["x"], wrong["law_x"], wrong["law_y"])) / wrong["force_sd"]
    assert np.sqrt(np.mean(apart**2)) > 3.0


def test_points_of_a_law_narrower_than_a_bin_lie_along_it(bench) -> None:
    cogging = bench.effect("cogging")
    values = cogging.seeds[-1]
    fit = dataclasses.replace(bench.nominal, effects=(cogging,), values=(values,))
    left = locate(bench.shooting, bench.nominal)
    (law,) = laws(bench.engine.channels, left, fit, fit.effects)
    (over,) = (region for region in left if (region.joint, region.over) == ("hip", "qpos.hip"))
    drawn = cogging.force(np.array(law["x"]), np.zeros(len(law["x"])), values)
    np.testing.assert_allclose(np.array(law["force"]) - over.force, drawn)
    assert np.ptp(drawn) > 0.0


def test_the_law_is_drawn_as_far_as_the_machine_went(bench, damped) -> None:
    """A stop that is met for a moment lies beyond the bins' last edges, which hold the middle 99 %."""
    left = locate(bench.shooting, damped)
    (over,) = (region for region in left if (region.joint, region.over) == ("hip", "qvel.hip"))
    (law,) = laws(bench.engine.channels, left, damped, damped.effects)
    assert over.reach[1] > over.edges[-1]
    np.testing.assert_allclose([law["law_x"][0], law["law_x"][-1]], over.bounds[[0, -1]])


def test_an_effect_without_a_force_law_has_none(bench) -> None:
    fit = bench.fit("armature_error", 0.01)
    assert laws(bench.engine.channels, locate(bench.shooting, fit), fit, fit.effects) == []
