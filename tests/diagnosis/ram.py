"""A ram on a spring that meets a wall, recorded at 100 Hz from MuJoCo's own steps."""

from __future__ import annotations

import mujoco
import numpy as np

from torch_activegp.data import Recording
from torch_activegp.diagnosis.inputs.machine import Machine, make_machine

_XML = """
<mujoco><option timestep="{step}" gravity="0 0 0"/><worldbody>
<geom type="plane" pos="0.2 0 0" zaxis="-1 0 0" size="1 1 .1" condim="1" solref="{soft} 0.3"/>
<body name="ram"><joint name="x" type="slide" axis="1 0 0" stiffness="40" damping="0.4"/>
<geom type="sphere" size="0.05" mass="1" condim="1" solref="{soft} 0.3"/></body></worldbody>
<actuator><motor name="coil" joint="x"/></actuator></mujoco>"""


def ram(step: float, soft: float, noise: float, rows: int, push: float = 0.0, truth: float | None = None) -> Machine:
    """The machine and its recording.

    Args:
        step: of the model, s.
        soft: time constant of the contact, s.
        noise: standard deviation, m.
        rows: recorded.
        push: what the coil pushes towards the wall beside its sine, N.
        truth: step of the simulation that is recorded, s; the model's own where there is none.
    """
    model, made = (mujoco.MjModel.from_xml_string(_XML.format(step=h, soft=soft)) for h in (step, truth or step))
    data, rng = mujoco.MjData(made), np.random.default_rng(0)
    time = np.arange(rows) / 100
    control = push + 9.0 * np.sin(2 * np.pi * 1.1 * time)
    position = []
    for force in control:
        position.append(data.qpos[0])
        data.ctrl[:] = force
        mujoco.mj_step(made, data, round(0.01 / made.opt.timestep))
    assert max(position) > 0.15
    columns = {"time": time, "qpos.x": np.array(position) + noise * rng.normal(size=rows), "ctrl.coil": control}
    recording = Recording.from_columns("strikes", columns)
    return make_machine(model, [recording], [recording])
