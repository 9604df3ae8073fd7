"""A load, and the rotor of its motor on the other side of a gap: as one joint, and as two."""

from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np

from torch_activegp.physics import Place

JOINT = Place("joint:load", 0, position=(-1.0, 1.0))
ROTOR = 0.02
WITH_PLAY = """
<mujoco><option timestep="{step}" gravity="0 0 {gravity}"/><worldbody>
<body><joint name="load" axis="0 1 0" damping=".03" armature="{armature}"/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 -.5" mass="1"/></body>{rotor}</worldbody>{gap}
<actuator><motor joint="{driven}" gear="2"/></actuator></mujoco>"""


def nominal(step: float, gravity: float = 0.0, armature: float = ROTOR) -> str:
    return WITH_PLAY.format(step=step, gravity=gravity, armature=armature, rotor="", gap="", driven="load")


def two_masses(
    bench: Any,
    gap: float,
    step: float,
    gravity: float,
    control: np.ndarray,
    begin: tuple[float, float],
    damped: bool = False,
) -> np.ndarray:
    """Positions of load and rotor as bodies of their own, whose angle to each other has limits, ``(T, 2)``."""
    xml = WITH_PLAY.format(
        step=step,
        gravity=gravity,
        armature=0,
        rotor=f'<body><joint name="rotor" axis="0 1 0" armature="{ROTOR}"/><geom size=".001" mass="1e-6"/></body>',
        gap=f'<tendon><fixed limited="true" range="{-gap / 2} {gap / 2}" solreflimit="{2 * step} 1" '
        'solimplimit=".99 .999 .0001"><joint joint="rotor" coef="1"/><joint joint="load" coef="-1"/></fixed></tendon>',
        driven="rotor",
    )
    xml = with_damped_rotor(xml) if damped else xml
    machine = dataclasses.replace(bench, xml=xml, start=begin, control=control)
    return np.asarray(machine.nominal()[:, :2])


def with_damped_rotor(xml: str) -> str:
    """The load's damping on the rotor instead."""
    return xml.replace(' damping=".03"', "").replace('joint name="rotor"', 'joint name="rotor" damping=".03"')


def swings(step: float) -> np.ndarray:
    t = np.arange(0.0, 1.5, step)[:, None] * 2 * np.pi
    return np.asarray(0.5 * np.sin(1.3 * t + 0.3) + 0.4 * np.sin(0.47 * t))


def with_springs(
    gap: float,
    stiffness: float,
    damping: float,
    control: np.ndarray,
    damped: bool = False,
    begin: tuple[float, float] = (0.0, 0.0),
) -> np.ndarray:
    """The same, ``(T, 2)``, with the ends of the gap by hand in steps of 0.1 ms."""
    rotor = f'<body><joint name="rotor" axis="0 1 0" armature="{ROTOR}"/><geom size=".001" mass="1e-6"/></body>'
    xml = WITH_PLAY.format(step=1e-4, gravity=0.0, armature=0, rotor=rotor, gap="", driven="rotor")
    model = mujoco.MjModel.from_xml_string(with_damped_rotor(xml) if damped else xml)
    data = mujoco.MjData(model)
    data.qpos[:] = begin
    seen = []
    for row in control:
        for _ in range(10):
            data.ctrl[:] = row
            twist, faster = data.qpos[1] - data.qpos[0], data.qvel[1] - data.qvel[0]
            push = stiffness * (twist - np.sign(twist) * 0.5 * gap) + damping * faster
            face = push if abs(twist) > 0.5 * gap and push * twist > 0.0 else 0.0
            data.qfrc_applied[:] = face, -face
            mujoco.mj_step(model, data)
        seen.append(data.qpos.copy())
    return np.array(seen)
