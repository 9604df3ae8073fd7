from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis import evaluate
from torch_activegp.diagnosis.inputs.machine import make_machine
from torch_activegp.diagnosis.inputs.wrong_limits import clipping_notes, doubt_limits

XML = """
<mujoco><option timestep="0.002"><flag clampctrl="{flag}"/></option><worldbody>
<body><joint name="slide" type="slide" damping="1"/><geom size=".1" mass="2"/></body></worldbody>
<actuator><motor name="push" joint="slide" {limits}/></actuator></mujoco>"""
TIME = np.arange(0.0, 2.0, 0.01)


def model_of(limits: str, flag: str = "enable") -> mujoco.MjModel:
    given = f'ctrllimited="true" ctrlrange="{limits}"' if limits else ""
    return mujoco.MjModel.from_xml_string(XML.format(flag=flag, limits=given))


def record(scale: float, middle: float = 0.0, name: str = "run") -> Recording:
    """A slide under a swinging force."""
    push = middle + scale * np.sin(7.0 * TIME)
    columns = {"time": TIME, "qpos.slide": 1e-2 * np.sin(3.0 * TIME), "ctrl.push": push}
    return Recording.from_columns(name, columns)


@pytest.mark.parametrize(
    ("scale", "middle", "limits", "flag", "doubted", "noted"),
    [
        (900.0, 0.0, "-9.5 9.5", "enable", True, False),
        (9.0, 0.0, "-9.5 9.5", "enable", False, False),
        (9.0, 0.0, "-2.5 2.5", "enable", False, True),  # a controller's command before the drive's limit
        (1.3, -1.5, "0 6", "enable", True, False),  # all rows are clipped to 0
        (0.0, -1.5, "0 6", "enable", False, True),
        (0.0, 0.0, "0.1 1", "enable", False, True),
        (1.3, 0.5, "0 6", "enable", False, True),
        (2.7, 3.0, "0 6", "enable", False, False),
        (900.0, 0.0, "-9.5 9.5", "disable", False, False),
        (900.0, 0.0, "", "enable", False, False),
    ],
)
def test_a_control_far_beyond_the_models_limits_is_doubted_and_one_less_far_is_noted(
    scale: float, middle: float, limits: str, flag: str, doubted: bool, noted: bool
) -> None:
    """What is clipped says nothing of its unit."""
    model, run = model_of(limits, flag), record(scale, middle)
    doubts, notes = doubt_limits(model, [run]), clipping_notes(model, [run])
    assert (bool(doubts), bool(notes)) == (doubted, noted)
    if scale == 900.0 and doubted:
        assert doubts[0].startswith("run, column `ctrl.push`: -900 to 900, in 99% of the rows beyond the model's own")
    if scale == 1.3 and doubted:
        assert "With the other sign it is within: if so, say ctrl.push = { sign = -1 }" in doubts[0]
    if scale == 1.3 and noted:
        assert notes[0].startswith("run, column `ctrl.push`: -0.8 to 1.8, in 34% of the rows beyond")


def test_a_run_beyond_an_end_is_no_doubt_where_another_one_is_within_or_all_are_just_beyond() -> None:
    model, out, near, within = model_of("-1 1"), record(0.5, 2.0), record(0.02, 1.07), record(0.5)
    assert len(doubt_limits(model, [out, out])) == 1
    for runs in ([out, within], [near, near]):
        assert doubt_limits(model, runs) == []
        assert len(clipping_notes(model, runs)) == 1
    far = record(900.0)
    assert clipping_notes(model, [far, out, within]) == []  # for it is doubted


@pytest.mark.parametrize("first", [1.0, 100.0])
def test_one_of_several_recordings_of_one_name_is_enough(first: float) -> None:
    model, runs = model_of("-9.5 9.5"), [record(9.0 * first), record(900.0 / first), record(900.0)]
    (found,) = doubt_limits(model, runs)
    assert found.startswith("run and 1 more, column `ctrl.push`: -900 to 900")


def test_controls_beyond_limits_are_told_of_runs_that_are_fitted_and_held_out() -> None:
    model, good, far, near = model_of("-9.5 9.5"), record(9.0, 0.0, "good"), record(900.0), record(18.0)
    for recordings, holdout in (([far], [good]), ([good], [far])):
        machine = make_machine(model, recordings, holdout)
        (found,) = [doubt for doubt in machine.doubts if "the model's own limits" in doubt]
        assert found in machine.notes
    assert found in evaluate(model, [far], nthread=1)["notes"]
    for recordings, holdout in (([near], [good]), ([good], [near])):
        machine = make_machine(model, recordings, holdout)
        assert not [doubt for doubt in machine.doubts if "limits" in doubt]
        assert sum("the model's own limits" in note for note in machine.notes) == 1
