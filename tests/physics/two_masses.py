"""A load, and the rotor of its motor on the other side of a gap: as one joint, and as two."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np

from torch_activegp.physics import Effect, Place, Step

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


def seen(
    effect: Effect, values: Sequence[float], control: np.ndarray, xml: str, middle: float = 0.0, start: float = 0.0
) -> np.ndarray:
    """What an encoder sees of a joint with an effect in each step of the model, ``(T, 2)``: position and speed."""
    model, rows, row = mujoco.MjModel.from_xml_string(xml), np.array([0]), np.array([list(values)])
    data, out, step = mujoco.MjData(model), [], np.array([model.opt.timestep])
    data.qpos[0] = start

    def field(name: str) -> np.ndarray:
        return np.asarray(getattr(model, name))[None]

    effect.edit(field, rows, row)
    memory = effect.memory(np.full((1, 9), start), np.zeros((1, 2), dtype=int), row)
    for one in control:
        data.ctrl[:], data.qfrc_applied[:] = one, 0.0
        state = data.qpos[None], data.qvel[None], data.ctrl[None], data.qfrc_applied[None]
        effect.before_step(Step(*state, field, step, middle), rows, row, memory)
        mujoco.mj_step(model, data)
        qpos, qvel = data.qpos[None].copy(), data.qvel[None].copy()
        effect.show(qpos, qvel, rows, row, memory)
        out.append((qpos[0, 0], qvel[0, 0]))
    return np.array(out)


def with_springs(
    gap: float,
    stiffness: float,
    damping: float,
    control: np.ndarray,
    damped: bool = False,
    begin: tuple[float, float] = (0.0, 0.0),
    step: float = 0.001,
) -> np.ndarray:
    """The same, ``(T, 2)``, with the ends of the gap by hand in steps of 0.1 ms, for controls held for longer ones."""
    rotor = f'<body><joint name="rotor" axis="0 1 0" armature="{ROTOR}"/><geom size=".001" mass="1e-6"/></body>'
    xml = WITH_PLAY.format(step=1e-4, gravity=0.0, armature=0, rotor=rotor, gap="", driven="rotor")
    model = mujoco.MjModel.from_xml_string(with_damped_rotor(xml) if damped else xml)
    data = mujoco.MjData(model)
    data.qpos[:] = begin
    seen = []
    for row in control:
        for _ in range(round(step / 1e-4)):
            data.ctrl[:] = row
            twist, faster = data.qpos[1] - data.qpos[0], data.qvel[1] - data.qvel[0]
            push = stiffness * (twist - np.sign(twist) * 0.5 * gap) + damping * faster
            face = push if abs(twist) > 0.5 * gap and push * twist > 0.0 else 0.0
            data.qfrc_applied[:] = face, -face
            mujoco.mj_step(model, data)
        seen.append(data.qpos.copy())
    return np.array(seen)
