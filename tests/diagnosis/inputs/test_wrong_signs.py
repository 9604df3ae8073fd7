from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.wrong_signs import check_signs
from torch_activegp.errors import DataError


def test_recordings_as_they_are_pass(bench, clean) -> None:
    for made in (bench, clean):
        check_signs(made.machine.model, made.machine.channels, made.machine.fit)


def test_a_motor_that_is_wired_the_other_way_round_is_refused(bench) -> None:
    model = mujoco.MjModel.from_xml_string(bench.xml.replace("<motor", '<motor gear="-1"'))
    with pytest.raises(DataError, match=r"`ctrl\.drive`: the sign.*ctrl\.drive = .*sign = -1"):
        check_signs(model, bench.machine.channels, bench.machine.fit)


def test_a_position_that_counts_down_is_refused(bench) -> None:
    """A rod that hangs aslant: neither its motor nor gravity moves its mirror image so."""
    model = mujoco.MjModel.from_xml_string(bench.xml.replace('pos="0 0 -0.5"', 'pos="0.4 0 -0.3"'))
    time, data = np.arange(801) / 100, mujoco.MjData(model)
    control, angles = 0.8 * np.sin(4.0 * time) + 0.5 * np.cos(1.7 * time), []
    for u in control:
        angles.append(data.qpos[0])
        data.ctrl[:] = u
        mujoco.mj_step(model, data, 2)
    for sign in (1.0, -1.0):
        columns = {"time": time, "qpos.hip": sign * np.array(angles), "ctrl.drive": control}
        recording = Recording.from_columns("aslant", columns)
        if sign > 0.0:
            make_machine(model, [recording], [])
            continue
        with pytest.raises(DataError, match=r"Column `qpos\.hip`: the sign"):
            make_machine(model, [recording], [])


def test_where_motion_is_prescribed_nothing_is_said(bench) -> None:
    model = mujoco.MjModel.from_xml_string(bench.xml.replace("<motor", '<motor gear="-1"'))
    channels = dataclasses.replace(bench.machine.channels, prescribed=bench.machine.channels)
    check_signs(model, channels, bench.machine.fit)


def test_a_drive_that_friction_holds_is_not_doubted(bench) -> None:
    """It lacks all that the drive gives, and twice that with the other sign of the motion."""
    still = [
        dataclasses.replace(run, smooth=0.02 * run.smooth, velocity=0.02 * run.velocity, noise=1e-3 * run.noise)
        for run in bench.machine.fit
    ]
    check_signs(bench.machine.model, bench.machine.channels, still)
