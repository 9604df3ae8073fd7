from __future__ import annotations

import dataclasses
import io
from types import SimpleNamespace

import mujoco
import numpy as np
import pandas as pd
import pytest

from torch_activegp.diagnosis.findings.experiment import (
    SECONDS,
    _beyond,
    _chosen,
    _leaving,
    _limits,
    _multisine,
    _reach,
    _replayed,
    next_experiment,
)
from torch_activegp.diagnosis.simulation.engine import Engine


@pytest.fixture(scope="module")
def rivals(bench) -> list:
    return [bench.fit("viscous_friction", 0.05), bench.fit("quadratic_drag", 0.02)]


def test_the_controls_stay_within_what_was_seen_and_are_a_recording(bench, rivals) -> None:
    entry, text = next_experiment(bench.engine, rivals, bench.machine.fit, bench.shooting.noise, 0)
    table = pd.read_csv(io.StringIO(text))
    assert list(table) == ["time", "ctrl.drive"]
    np.testing.assert_allclose(table["time"], np.arange(round(100 * SECONDS) + 1) / 100)
    seen = max(np.abs(run.control).max() for run in bench.machine.fit)
    assert 0.05 * seen < table["ctrl.drive"].abs().max() <= seen + 1e-9
    assert entry["separates"] == ["viscous_friction", "quadratic_drag"]
    assert entry["controls"] == "next.csv"
    assert "run0" in entry["why"]


def test_the_predicted_gain_is_what_the_rivals_differ_by(bench, rivals) -> None:
    entry, text = next_experiment(bench.engine, rivals, bench.machine.fit, bench.shooting.noise, 0)
    control = pd.read_csv(io.StringIO(text))["ctrl.drive"].to_numpy()
    ends = []
    for fit in rivals:
        model = mujoco.MjModel.from_xml_string(bench.xml)
        data = mujoco.MjData(model)
        run = bench.machine.fit[0]
        data.qpos[0], data.qvel[0] = run.smooth[0, 0], run.velocity[0, 0]
        seen = []
        for u in control:
            seen.append(data.qpos[0])
            data.ctrl[:] = u
            for _ in range(2):
                data.qfrc_applied[0] = fit.effects[0].force(data.qpos, data.qvel, fit.values[0])[0]
                mujoco.mj_step(model, data)
        ends.append(np.array(seen))
    assert entry["predicted_gain"] == pytest.approx((((ends[0] - ends[1]) / bench.noise) ** 2).sum(), rel=0.05)


def test_rivals_are_told_apart_by_what_they_do_not_share(bench, rivals) -> None:
    wet, drag = rivals
    both = dataclasses.replace(wet, effects=(*wet.effects, *drag.effects), values=(*wet.values, *drag.values))
    other = dataclasses.replace(bench.effect("viscous_friction"), target="joint:knee")
    elsewhere = dataclasses.replace(wet, effects=(other,))
    assert (_beyond(both, wet), _beyond(wet, both)) == ("quadratic_drag", "what both share")
    assert _beyond(bench.nominal, wet) == "no effect"
    assert _beyond(wet, elsewhere) == "viscous_friction at joint:hip"


def test_of_several_trials_the_one_that_separates_most_is_taken(bench, rivals, monkeypatch) -> None:
    arguments = (bench.engine, rivals, bench.machine.fit, bench.shooting.noise, 0)
    many = next_experiment(*arguments)[0]["predicted_gain"]
    monkeypatch.setattr("torch_activegp.diagnosis.findings.experiment._TRIALS", 1)
    assert next_experiment(*arguments)[0]["predicted_gain"] < many


def test_equal_seeds_give_equal_controls_and_others_do_not(bench, rivals) -> None:
    first, again, other = (
        next_experiment(bench.engine, rivals, bench.machine.fit, bench.shooting.noise, seed)[1] for seed in (3, 3, 4)
    )
    assert first == again != other


@pytest.mark.parametrize(("low", "high"), [(-0.2, 0.3), (0.0, 0.5)])
def test_the_limits_of_the_actuator_hold(bench, rivals, low, high) -> None:
    motor = f'<motor ctrllimited="true" ctrlrange="{low} {high}"'
    engine = Engine(mujoco.MjModel.from_xml_string(bench.xml.replace("<motor", motor)), bench.engine.channels, 2, 1)
    _, text = next_experiment(engine, rivals, bench.machine.fit, bench.shooting.noise, 0)
    control = pd.read_csv(io.StringIO(text))["ctrl.drive"]
    assert low <= control.min() < control.max() <= high
    assert np.ptp(control) > 0.1


def test_limits_that_mujoco_does_not_hold_are_none(bench) -> None:
    text = bench.xml.replace("<motor", '<motor ctrllimited="true" ctrlrange="-0.5 0.5"')
    text = text.replace("<worldbody>", '<option><flag clampctrl="disable"/></option><worldbody>')
    engine = Engine(mujoco.MjModel.from_xml_string(text), bench.engine.channels, 2, 1)
    runs = tuple(dataclasses.replace(run, control=2.0 + np.sin(run.time[:-1, None])) for run in bench.machine.fit)
    low, middle, high = _limits(engine, runs)
    assert 1.0 <= low[0] < middle[0] < high[0] <= 3.0


def test_an_actuator_without_input_has_no_column(bench, rivals) -> None:
    loss = '<dcmotor name="loss" joint="hip" motorconst="0 0" resistance="1" input="none"/><motor'
    engine = Engine(mujoco.MjModel.from_xml_string(bench.xml.replace("<motor", loss)), bench.engine.channels, 2, 1)
    _, text = next_experiment(engine, rivals, bench.machine.fit, bench.shooting.noise, 0)
    assert text.splitlines()[0] == "time,ctrl.drive"
    assert len(text.splitlines()[1].split(",")) == 2


def test_nothing_is_proposed_without_two_rivals_or_without_controls(bench, rivals) -> None:
    arguments = (bench.machine.fit, bench.shooting.noise, 0)
    assert next_experiment(bench.engine, rivals[:1], *arguments) is None
    model = mujoco.MjModel.from_xml_string(bench.xml.split("<actuator>")[0] + "</mujoco>")
    assert next_experiment(Engine(model, bench.engine.channels, 2, 1), rivals, *arguments) is None


def test_rivals_that_no_control_tells_apart_ask_for_no_experiment(bench, rivals) -> None:
    arguments = (bench.engine, [rivals[0], rivals[0]], bench.machine.fit, bench.shooting.noise, 0)
    assert next_experiment(*arguments) is None


def test_controls_stay_around_their_mean_and_between_the_ends_seen(bench) -> None:
    """A hoist that carries a load is never let go."""
    loaded = tuple(dataclasses.replace(run, control=3.0 + 0.2 * run.control) for run in bench.machine.fit)
    low, middle, high = _limits(bench.engine, loaded)
    assert 2.0 < low[0] < middle[0] < high[0] < 4.0
    rng = np.random.default_rng(0)
    for _ in range(20):
        control = _multisine(rng, np.arange(500) / 100, low, middle, high)
        assert low[0] <= control.min() < middle[0] < control.max() <= high[0]


def test_trials_that_stay_near_go_before_those_that_tell_more(bench, rivals, monkeypatch) -> None:
    arguments = (bench.engine, rivals, bench.machine.fit, bench.shooting.noise, 0)
    entry, _ = next_experiment(*arguments)
    assert "near the positions seen" in entry["why"]
    monkeypatch.setattr("torch_activegp.diagnosis.findings.experiment._NEAR", 100.0)
    most = next_experiment(*arguments)[0]["predicted_gain"]
    assert entry["predicted_gain"] <= most
    monkeypatch.setattr("torch_activegp.diagnosis.findings.experiment._NEAR", -0.45)
    away = next_experiment(*arguments)[0]
    assert away["predicted_gain"] < most
    assert (
        "started. Simulate these controls first: none were found that tell and keep the machine near; hip "
        in away["why"]
    )


@pytest.mark.parametrize(
    ("apart", "astray", "chosen"),
    [
        ([5.0, 9.0, 30.0], [0.0, 0.0, 0.1], 1),  # of those that stay near the one that tells most
        ([9.0, 3.0, 30.0], [0.5, 0.0, 0.2], 2),  # what stays near tells nothing: the nearest that tells
        ([5.0, 9.0, 30.0], [0.5, 0.55, 0.7], 1),  # and of those about as near the one that tells more
        ([1.0, 3.0, 2.0], [0.2, 0.1, 0.0], 1),
    ],
)
def test_of_trials_that_leave_what_was_seen_the_nearest_that_tells_is_chosen(apart, astray, chosen) -> None:
    assert _chosen(np.array(apart), np.array(astray)) == chosen


def test_a_joint_leaves_what_is_near_by_parts_of_it() -> None:
    two = SimpleNamespace(channels=SimpleNamespace(joints=("rail", "elbow"), hinge=(False, True)))
    told = _leaving(two, np.array([0.3, 0.2]), np.array([3.0, 0.1]))
    assert told.endswith("elbow leaves the positions seen by 0.2 rad")


def test_near_is_half_the_range_seen_beyond_its_ends_and_within_the_limits(bench) -> None:
    seen = np.concatenate([run.smooth for run in bench.machine.fit])
    reach = _reach(bench.engine, bench.machine.fit)
    np.testing.assert_allclose(np.diff(reach, axis=0), 2.0 * np.ptp(seen))
    limited = bench.integrated("RK4", 0.005, f'limited="true" range="{np.rad2deg(seen.min()) - 1} 900"').model
    held = _reach(Engine(limited, bench.engine.channels, 2, 1), bench.machine.fit)
    np.testing.assert_allclose(held[0], seen.min() - np.deg2rad(1.0))
    np.testing.assert_array_equal(held[1], reach[1])


def test_some_controls_stay_close_to_what_the_first_recording_had(bench) -> None:
    run = bench.machine.fit[0]
    replayed = _replayed(run, len(run.control) + 5, np.array([0.25]))
    np.testing.assert_array_equal(replayed[:-5], run.control)
    assert (replayed[-5:] == 0.25).all()
    np.testing.assert_array_equal(_replayed(run, 7, np.zeros(1)), run.control[:7])
