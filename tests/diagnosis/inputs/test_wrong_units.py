from __future__ import annotations

import dataclasses
import re

import mujoco
import numpy as np
import pytest

from tests.diagnosis.cone import cone
from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.wrong_units import check_units, forces_of, motion_of
from torch_activegp.errors import DataError


def scaled(bench, factor: float, noise: float | None = None):
    """The runs with all that belongs to the position multiplied."""
    return [
        dataclasses.replace(
            run,
            smooth=factor * run.smooth,
            velocity=factor * run.velocity,
            noise=factor * run.noise if noise is None else np.full_like(run.noise, noise),
        )
        for run in bench.machine.fit
    ]


def check(bench, runs) -> list[str]:
    return check_units(bench.machine.model, bench.machine.channels, runs)


def test_degrees_are_refused_and_named(bench) -> None:
    assert check(bench, scaled(bench, 1.0)) == []
    with pytest.raises(DataError, match=r'qpos\.hip.*in deg it would not.*unit = "deg"'):
        check(bench, scaled(bench, 180 / np.pi))


def test_what_another_unit_would_explain_but_not_all_is_doubted(bench, monkeypatch) -> None:
    monkeypatch.setattr("torch_activegp.diagnosis.inputs.wrong_units._GOOD", 0.0)
    (doubt,) = check(bench, scaled(bench, 180 / np.pi))
    assert re.search(r"would take \d+ times the forces that the model has; in deg 0\.\d\. If so, name it", doubt)
    assert check(bench, scaled(bench, 1.0)) == []


def test_where_motion_is_prescribed_nothing_is_said(bench) -> None:
    channels = dataclasses.replace(bench.machine.channels, prescribed=bench.machine.channels)
    check_units(bench.machine.model, channels, scaled(bench, 180 / np.pi))


def test_what_noise_could_be_is_let_pass(bench) -> None:
    check(bench, scaled(bench, 180 / np.pi, noise=1e3))
    check(bench, [dataclasses.replace(run, time=100.0 * run.time) for run in scaled(bench, 1.0)])


@pytest.mark.parametrize("unit", ["mm", "cm"])
def test_slides_in_millimetres_are_refused(bench, unit) -> None:
    """The same motion on a slide that the same forces drive."""
    xml = bench.xml.replace('name="hip" axis="0 1 0"', 'name="hip" type="slide" axis="1 0 0" stiffness="15"')
    model = mujoco.MjModel.from_xml_string(xml)
    channels = dataclasses.replace(bench.machine.channels, hinge=np.array([False]))
    small = [dataclasses.replace(run, control=run.control * 10.0) for run in scaled(bench, 1.0)]
    check_units(model, channels, small)
    factor = {"mm": 1e3, "cm": 1e2}[unit]
    large = [dataclasses.replace(run, control=run.control * 10.0) for run in scaled(bench, factor)]
    with pytest.raises(DataError, match="in (mm|cm) it would not"):
        check_units(model, channels, large)


def test_a_model_that_lacks_as_much_as_it_has_is_no_unit(bench) -> None:
    """Forces three times too weak, in radians: in degrees it would fit no better than it does."""
    weak = [dataclasses.replace(run, control=run.control / 3.0) for run in scaled(bench, 1.0)]
    check(bench, weak)


def test_the_run_that_is_in_degrees_is_named(bench) -> None:
    right, wrong = scaled(bench, 1.0), scaled(bench, 180 / np.pi)
    mixed = [right[0], dataclasses.replace(wrong[1], label="bad")]
    with pytest.raises(DataError, match=r"^bad, column `qpos\.hip`"):
        check(bench, mixed)


def test_one_joint_of_two_in_degrees_is_the_one_that_is_named(double) -> None:
    """Whatever else moves because of it; a model that lacks a hundred times what it has is no doubt any more."""
    run = double.record(0, seconds=2.0)
    wrong = run.replace({"qpos.elbow": run["qpos.elbow"] * 180 / np.pi})
    words = r'qpos\.elbow = \{ column = "\.\.\.", unit = "deg" \}, in place of any unit there'
    with pytest.raises(DataError, match=words):
        make_machine(double.model(), [dataclasses.replace(wrong, prescribed=())] * 2, [])


def test_what_is_fast_in_a_control_does_not_seem_to_be_lacking() -> None:
    """A sled whose command changes in each row: its acceleration is seen over 0.3 s, and so is the command."""
    sled = mujoco.MjModel.from_xml_string(
        '<mujoco><option timestep="0.01"/><worldbody><body><joint name="x" type="slide"/><geom size=".1" mass="2"/>'
        '</body></worldbody><actuator><motor name="push" joint="x"/></actuator></mujoco>'
    )
    control, data, rows = 20.0 * np.random.default_rng(0).normal(size=600), mujoco.MjData(sled), []
    control += 5.0 * np.sin(0.05 * np.arange(600))
    for u in control:
        rows.append(float(data.qpos[0]))
        data.ctrl[:] = u
        mujoco.mj_step(sled, data)
    columns = {"time": 0.01 * np.arange(600), "qpos.x": np.array(rows), "ctrl.push": control}
    machine = make_machine(sled, [Recording.from_columns("run", columns)], [])
    motion = motion_of(machine.fit)
    assert motion is not None
    assert motion.control.std() < 0.6 * control.std()
    lacking, there = forces_of(sled, machine.channels, motion, np.ones(1))
    assert lacking[0] < 0.2 * there[0]


def test_what_is_fast_in_a_motion_does_not_seem_to_be_lacking_either() -> None:
    machine = cone(3100.0)
    motion = motion_of(machine.fit)
    assert motion is not None
    swing = machine.fit[0].smooth.std()
    assert motion.position.std() < 0.1 * swing
    lacking, _ = forces_of(machine.model, machine.channels, motion, np.ones(1))
    assert lacking[0] < 0.01 * 3100.0 * swing
