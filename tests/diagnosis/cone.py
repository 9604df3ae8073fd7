"""The cone of a loudspeaker, and a second of its motion."""

from __future__ import annotations

import mujoco
import numpy as np

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine


def cone(stiffness: float, step: float = 0.0005, rate: int = 1000) -> Machine:
    """The machine and its recording.

    Args:
        stiffness: of its spring, N/m.
        step: of the model, s.
        rate: of the recording, Hz.
    """
    xml = f"""<mujoco><option timestep="{step}" integrator="RK4" gravity="0 0 0"/><worldbody><body>
    <joint name="coil" type="slide" axis="1 0 0" stiffness="{stiffness}" damping="0.3"/>
    <inertial pos="0 0 0" mass="0.016" diaginertia="1e-5 1e-5 1e-5"/></body></worldbody>
    <actuator><motor name="voice" joint="coil"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data, time, position = mujoco.MjData(model), np.arange(rate) / rate, []
    control = np.sin(2 * np.pi * 31.0 * time) + np.sin(2 * np.pi * 11.0 * time)
    for force in control:
        position.append(data.qpos[0])
        data.ctrl[:] = force
        mujoco.mj_step(model, data, round(1.0 / rate / step))
    noise = 1e-3 * np.std(position) * np.random.default_rng(0).normal(size=rate)
    columns = {"time": time, "qpos.coil": np.array(position) + noise, "ctrl.voice": control}
    run = Recording.from_columns("sine", columns)
    return make_machine(model, [run], [run])
