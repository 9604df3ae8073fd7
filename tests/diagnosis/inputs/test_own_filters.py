from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine
from torch_activegp.diagnosis.inputs.own_filters import own_filters, without_filters
from torch_activegp.diagnosis.inputs.runs import Channels
from torch_activegp.diagnosis.inputs.segments import cut
from torch_activegp.diagnosis.simulation.candidate import NOMINAL, Candidate
from torch_activegp.diagnosis.simulation.engine import Engine
from torch_activegp.diagnosis.simulation.forms import begin_drives
from torch_activegp.diagnosis.simulation.places import effects_for
from torch_activegp.errors import ConfigurationError

SERVO = """<mujoco><option timestep="0.002" integrator="RK4"/><worldbody><body>
<joint name="tilt" axis="0 1 0" damping="0.1"/><inertial pos="0 0 -0.2" mass="0.5" diaginertia="0.01 0.01 0.01"/>
</body></worldbody><actuator>
<position name="servo" joint="tilt" kp="4" timeconst="0.08"/>
<general name="slow" joint="tilt" dyntype="integrator"/>
<general name="limited" joint="tilt" dyntype="filter" dynprm="0.1" actlimited="true" actrange="-1 1"/>
<motor name="push" joint="tilt"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def machine() -> Machine:
    """A servo that MuJoCo itself moves in steps of 0.05 ms, recorded without noise."""
    model = mujoco.MjModel.from_xml_string(SERVO)
    fine = mujoco.MjModel.from_xml_string(SERVO)
    fine.opt.timestep = 5e-5
    data = mujoco.MjData(fine)
    time = np.arange(201) / 100
    command = 0.8 * np.sign(np.sin(7.0 * time + 0.5))
    data.act[0] = command[0]
    angle = []
    for u in command:
        angle.append(data.qpos[0])
        data.ctrl[:] = [u, 0.0, 0.0, 0.0]
        mujoco.mj_step(fine, data, 200)
    columns = {"time": time, "qpos.tilt": np.array(angle), "ctrl.servo": command}
    columns |= {f"ctrl.{name}": 0.0 * time for name in ("slow", "limited", "push")}
    return make_machine(model, [Recording.from_columns("run", columns)], [Recording.from_columns("kept", columns)])


RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


@pytest.mark.parametrize(("knows", "least", "most"), [(True, 0.0, 1e-3), (False, 0.02, 1.0)])
def test_a_segment_in_the_middle_of_a_run_knows_what_its_drive_does(machine, knows, least, most) -> None:
    segments = cut(machine.fit, 0.5, 0.0)
    engine = Engine(machine.model, machine.channels, 2, 1, RK4)
    if not knows:
        engine.filters, engine.model = (), machine.model
    starts = engine.starts(segments)
    starts[:, 0] = [machine.fit[0].position[first, 0] for first in segments.first]
    predicted = engine.predict(segments, starts[None], [NOMINAL])
    error = np.abs(predicted[0] - segments.position)[segments.counts].max()
    assert least < error < most


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
@pytest.mark.parametrize(
    "drive", ['dyntype="filter"', 'dyntype="filterexact"', 'dyntype="filterexact" actearly="true"']
)
@pytest.mark.parametrize("empty", [True, False])
def test_a_model_agrees_with_itself_in_its_own_steps(integrator: str, drive: str, empty: bool) -> None:
    """What MuJoCo records with a model, from an empty drive or a filled one, the same model follows to the digit."""
    xml = SERVO.replace("RK4", integrator).replace(
        '<position name="servo" joint="tilt" kp="4" timeconst="0.08"/>',
        f'<general name="servo" joint="tilt" {drive} dynprm="0.08" gainprm="4" biastype="affine" biasprm="0 -4"/>',
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data, time = mujoco.MjData(model), np.arange(151) / 100
    command = 0.8 * np.cos(7.0 * time)
    data.act[0] = 0.0 if empty else command[0]
    states = []
    for u in command:
        states.append([data.qpos[0], data.qvel[0]])
        data.ctrl[0] = u
        mujoco.mj_step(model, data, 5)
    columns = {"time": time, "qpos.tilt": np.array(states)[:, 0], "ctrl.servo": command}
    columns |= {f"ctrl.{name}": 0.0 * time for name in ("slow", "limited", "push")}
    run = make_machine(model, [Recording.from_columns("r", columns)], [Recording.from_columns("k", columns)]).fit[0]
    channels = Channels.of(model, [Recording.from_columns("r", columns)])
    engine = Engine(model, channels, 5, 1)
    begin_drives([engine], [run])
    assert engine.filters[0].empty == empty
    segments = cut([run], 0.5, 0.0)
    starts = np.array([states[first] for first in segments.first])
    predicted = engine.predict(segments, starts[None], [NOMINAL])
    np.testing.assert_allclose(predicted[0][segments.counts], segments.position[segments.counts], atol=1e-9)
    exact = Engine(model, channels, 40, 1, RK4)
    begin_drives([engine, exact], [run])
    near = exact.predict(segments, starts[None], [NOMINAL])
    assert 1e-8 < np.abs(near - predicted)[0][segments.counts].max() < 0.02


def test_what_is_no_filter_of_first_order_without_limits_stays(machine) -> None:
    model = mujoco.MjModel.from_xml_string(SERVO)
    (own,) = own_filters(model)
    assert (own.actuator, own.time_constant, own.lag.target) == (0, 0.08, "actuator:servo")
    without_filters(model, (own,))
    assert model.actuator_actadr.tolist() == [-1, 1, 2, -1]
    assert own_filters(model) == ()


@pytest.mark.parametrize("integrator", [None, RK4])
def test_effects_act_on_the_command_before_the_filter(machine, integrator: int | None) -> None:
    segments = cut(machine.fit, 0.5, 0.0)
    gain = next(e for e in effects_for(machine.model, machine.channels, machine.fit) if e.key == GAIN)
    engine = Engine(machine.model, machine.channels, 2, 1, integrator)
    starts = np.repeat(engine.starts(segments)[None], 2, axis=0)
    for run in machine.fit:
        doubled = dataclasses.replace(run, control=2.0 * run.control)
        twice = dataclasses.replace(segments, runs=(doubled,))
        by_effect = engine.predict(segments, starts, [NOMINAL, Candidate((gain,), (np.array([1.0]),))])
        by_command = engine.predict(twice, starts[:1], [NOMINAL])
        np.testing.assert_allclose(by_effect[1], by_command[0], atol=1e-9)
        assert np.abs(by_effect[1] - by_effect[0]).max() > 0.01


GAIN = ("actuator_gain", "actuator:servo")


@pytest.mark.parametrize(
    ("drive", "kind", "instead"), [("slow", "integrator", "its control's integral"), ("limited", "filter", "a motor")]
)
def test_a_drive_whose_state_nobody_knows_is_refused_where_it_was_used(machine, drive, kind, instead) -> None:
    run = machine.fit[0]
    columns = {"time": run.time, "qpos.tilt": run.position[:, 0], f"ctrl.{drive}": np.sin(run.time)}
    recording = Recording.from_columns("run", columns)
    with pytest.raises(ConfigurationError, match=rf"actuator `{drive}`: .*`{kind}`: no recording holds.*{instead}"):
        make_machine(machine.model, [recording], [recording])
