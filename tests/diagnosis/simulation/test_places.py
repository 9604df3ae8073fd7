from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest
import torch

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.simulation.places import _free, effects_for


def test_every_part_of_the_machine_gets_its_effects(bench) -> None:
    targets = {effect.target for effect in bench.effects}
    assert targets == {"joint:hip", "actuator:drive", "sensor:hip", "body:rod", "world"}
    names = {effect.name for effect in bench.effects}
    assert {"viscous_friction", "coulomb_friction", "sensor_delay", "actuator_lag", "payload_mass"} <= names


def test_scales_follow_the_size_of_the_motion(bench) -> None:
    run = bench.machine.fit[0]
    twice = dataclasses.replace(run, smooth=2 * run.smooth, position=2 * run.position, velocity=2 * run.velocity)
    found = {
        factor: {e.key: e for e in effects_for(bench.engine.model, bench.engine.channels, [made])}
        for factor, made in ((1, run), (2, twice))
    }

    def scale(factor: int, name: str, target: str = "joint:hip") -> float:
        return found[factor][name, target].parameters[0].scale

    assert scale(2, "coulomb_friction") == pytest.approx(2 * scale(1, "coulomb_friction"))
    assert scale(2, "viscous_friction") == pytest.approx(scale(1, "viscous_friction"))
    assert scale(2, "sensor_bias", "sensor:hip") == pytest.approx(2 * scale(1, "sensor_bias", "sensor:hip"))


def test_a_small_amount_is_small_beside_the_forces_of_the_motion(bench) -> None:
    run = bench.machine.fit[0]
    inertial = np.sqrt(np.mean((0.33 * np.gradient(run.velocity[:, 0], run.time)) ** 2))
    assert 0.001 * inertial < bench.effect("coulomb_friction").parameters[0].scale < 0.5 * inertial


def test_an_actuator_whose_control_rests_has_no_effects(bench) -> None:
    rest = [dataclasses.replace(run, control=np.ones_like(run.control)) for run in bench.machine.fit]
    effects = effects_for(bench.engine.model, bench.engine.channels, rest)
    assert not [effect for effect in effects if effect.target.startswith("actuator:")]


def test_nothing_is_tried_that_acts_on_a_prescribed_joint_alone(double) -> None:
    recordings = [double.record(seed, seconds=1.0).replace({"ctrl.rig": torch.linspace(0, 1, 101)}) for seed in (0, 1)]
    found = {}
    for prescribed in ((), ("shoulder",)):
        some = [dataclasses.replace(recording, prescribed=prescribed) for recording in recordings]
        machine = make_machine(double.model(), some, [])
        found[prescribed] = {e.target for e in effects_for(machine.model, machine.channels, machine.fit)}
    lost = {"joint:shoulder", "sensor:shoulder", "actuator:rig", "body:upper"}
    assert found["shoulder",] == found[()] - lost
    assert lost < found[()]
    assert "body:lower" in found["shoulder",]


@pytest.mark.parametrize("first", [True, False])
def test_an_actuator_without_input_has_no_effects_on_a_control(bench, first: bool) -> None:
    loss = '<dcmotor name="loss" joint="hip" motorconst="0 0" resistance="1" input="none"/>'
    drive = '<motor name="drive" joint="hip"/>'
    text = bench.xml.replace(drive, loss + drive if first else drive + loss)
    found = effects_for(mujoco.MjModel.from_xml_string(text), bench.engine.channels, bench.machine.fit)
    assert {e.target for e in found if e.target.startswith("actuator:")} == {"actuator:drive"}


def _names(bench, runs) -> set[str]:
    return {e.name for e in effects_for(bench.engine.model, bench.engine.channels, runs)}


def test_what_needs_a_joint_to_go_both_ways_is_tried_where_it_does(bench) -> None:
    run = bench.machine.fit[0]
    forward = dataclasses.replace(run, smooth=np.sort(run.smooth, axis=0), velocity=np.abs(run.velocity))
    back = dataclasses.replace(run, smooth=-forward.smooth, velocity=-forward.velocity)
    wanted, differs = {"hysteresis", "asymmetric_friction"}, {"asymmetric_friction"}
    for runs, there in (([run], wanted), ([forward], set()), ([forward, back], differs), ([forward, run], wanted)):
        names = _names(bench, runs)
        assert names & wanted == there
        assert {"coulomb_friction", "viscous_friction", "linear_spring"} <= names


def test_noise_at_rest_is_no_way_back(bench) -> None:
    run, rng = bench.machine.fit[0], np.random.default_rng(0)
    rows = np.arange(len(run))[:, None]
    there = np.minimum(rows / 20, 1.0) + 1e-3 * rng.standard_normal(rows.shape)
    resting = dataclasses.replace(run, smooth=there, velocity=np.gradient(there, axis=0), noise=np.array([1e-3]))
    assert not {"hysteresis", "asymmetric_friction"} & _names(bench, [resting])


def test_a_short_way_back_on_a_long_path_tells_the_directions_apart(bench) -> None:
    run = bench.machine.fit[0]
    rows = np.arange(len(run), dtype=float)[:, None]
    turn = 0.96 * len(rows)
    path = np.where(rows < turn, rows, 1.2 * turn - 0.2 * rows)
    path = dataclasses.replace(run, smooth=path, velocity=np.gradient(path, axis=0))
    assert {"hysteresis", "asymmetric_friction"} & _names(bench, [path]) == {"asymmetric_friction"}


HOPPER = """<mujoco><worldbody><geom type="plane" size="9 9 .1"/><body pos="0 0 0.5">
<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
<geom type="sphere" size="0.1" mass="1"/></body></worldbody></mujoco>"""


def test_where_a_joint_makes_something_touch_is_told_from_where_others_do() -> None:
    """A sphere on a floor goes up and down, and to and fro on its own: it touches the floor from -0.4 m on."""
    model, time = mujoco.MjModel.from_xml_string(HOPPER), np.arange(400) * 0.01
    columns = {"time": time, "qpos.x": np.sin(1.7 * time), "qpos.z": -0.3 + 0.12 * np.cos(5 * time)}
    machine = make_machine(model, [Recording.from_columns("hops", columns)] * 2, [])
    free = _free(model, machine.channels, machine.fit)
    np.testing.assert_array_equal(np.isfinite(free), [[False, False], [True, False]])
    assert free[1, 0] == pytest.approx(-0.4, abs=5e-3)
    stops = {
        (e.target, e.variant): e.parameters[2]
        for e in effects_for(model, machine.channels, machine.fit)
        if e.name == "joint_stop"
    }
    assert stops["joint:z", "lower"].high == pytest.approx(0.4 - 0.03 * 0.24, abs=5e-3)
    assert stops["joint:z", "upper"].high > 0.18 - 0.4 + 0.04
    assert stops["joint:x", "lower"].high > 1.0


def test_where_nothing_touches_everything_is_free(bench) -> None:
    free = _free(bench.engine.model, bench.engine.channels, bench.machine.fit)
    assert not np.isfinite(free).any()
