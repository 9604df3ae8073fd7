"""A small arm in plain MuJoCo, and one simulation of it with an effect in each of the effect's forms."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
import pytest

from torch_activegp.physics import Effect, Place, Step
from torch_activegp.physics.joint import JointEffect

STEP = 0.001
XML = """
<mujoco><compiler angle="radian"/><option timestep="0.001"/><worldbody>
<body name="upper"><joint name="shoulder" axis="0 1 0" damping="0.05" armature="0.02"/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 -.4" mass="1"/>
<body name="fore" pos="0 0 -.4"><joint name="elbow" axis="0 1 0" damping="0.02"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass=".5"/></body></body></worldbody>
<actuator><motor name="drive" joint="shoulder" gear="2"/>
<position name="servo" joint="elbow" kp="5" kv=".2"/></actuator></mujoco>"""
SHOULDER = Place("joint:shoulder", 0, position=(-0.4, 1.0), speed=2.0, top_speed=4.0, force=2.0, qpos=0)
ELBOW = Place("joint:elbow", 1, position=(-0.6, 0.9), speed=2.0, top_speed=4.0, force=0.5, qpos=1)
DRIVE = Place("actuator:drive", 0, control=1.5)
SERVO = Place("actuator:servo", 1, control=0.8, servo_force=2.0)


def sines() -> np.ndarray:
    """Controls ``(T, 2)`` over a second: sums of sines that start at zero."""
    t = np.arange(0.0, 1.0, STEP)[:, None] * 2 * np.pi
    return np.hstack([np.sin(1.3 * t) + 0.5 * np.sin(3.1 * t), 0.5 * np.sin(1.7 * t) + 0.3 * np.sin(2.3 * t)])


@dataclasses.dataclass(frozen=True)
class Bench:
    """Simulates the arm with an effect in one of its forms."""

    xml: str = XML
    shoulder: Place = SHOULDER
    elbow: Place = ELBOW
    drive: Place = DRIVE
    servo: Place = SERVO
    start: tuple[float, ...] = (0.0, 0.0)
    control: np.ndarray = dataclasses.field(default_factory=sines)

    @property
    def model(self) -> mujoco.MjModel:
        return mujoco.MjModel.from_xml_string(self.xml)

    @property
    def spec(self) -> mujoco.MjSpec:
        return mujoco.MjSpec.from_string(self.xml)

    def nominal(self) -> np.ndarray:
        """States ``(T, nq + nv)`` without any effect."""
        return self.run(self.model)

    def hooks(self, effect: Effect, values: Sequence[float]) -> np.ndarray:
        """The effect by its edit of the model, its change of the control, and what it does in each step."""
        model, row, rows = self.model, np.array([list(values)], dtype=float), np.array([0])

        def field(name: str) -> np.ndarray:
            return (model.opt.gravity if name == "opt.gravity" else _timestep(model, name))[None]

        if effect.edit(field, rows, row):
            mujoco.mj_setConst(model, mujoco.MjData(model))
        control = self.control[None, None].copy()
        effect.control(control, np.full((1, len(self.control)), STEP), row)
        memory = effect.memory(np.zeros((1, 2)), np.zeros((1, 2), dtype=int), row)

        steady = np.zeros((1, model.nv))
        effect.steady(steady, rows, row)

        def before(data: mujoco.MjData) -> None:
            data.qfrc_applied[:] += steady[0]
            if not effect.needs_steps:
                return
            seen = Step(
                data.qpos[None], data.qvel[None], data.ctrl[None], data.qfrc_applied[None], field, np.array([STEP])
            )
            effect.before_step(seen, rows, row, memory)

        def show(qpos: np.ndarray, qvel: np.ndarray) -> None:
            effect.show(qpos, qvel, rows, row, memory)

        return self.run(model, control[0, 0], before, show)

    def force(self, effect: JointEffect, values: Sequence[float]) -> np.ndarray:
        """The effect by its law alone."""

        def before(data: mujoco.MjData) -> None:
            q, v = data.qpos[[effect.qpos]], data.qvel[[effect.dof]]
            data.qfrc_applied[effect.dof] += effect.force(q, v, np.array(values))[0]

        return self.run(self.model, before=before)

    def written(self, effect: Effect, values: Sequence[float]) -> np.ndarray:
        """The effect as the model's file holds it, written and read again."""
        spec = self.spec
        assert effect.write(spec, np.array(values, dtype=float))
        spec.compile()
        return self.run(mujoco.MjModel.from_xml_string(spec.to_xml()))

    def run(
        self,
        model: mujoco.MjModel,
        control: np.ndarray | None = None,
        before: Callable[[mujoco.MjData], None] | None = None,
        show: Callable[[np.ndarray, np.ndarray], None] | None = None,
    ) -> np.ndarray:
        """States ``(T, nq + nv)`` after each step, as they are shown."""
        data, states = mujoco.MjData(copy.copy(model)), []
        data.qpos[: len(self.start)] = self.start
        for u in self.control if control is None else control:
            data.ctrl[:], data.qfrc_applied[:] = u[: model.nu], 0.0
            if before is not None:
                before(data)
            mujoco.mj_step(model, data)
            qpos, qvel = data.qpos[None].copy(), data.qvel[None].copy()
            if show is not None:
                show(qpos, qvel)
            states.append(np.concatenate([qpos[0], qvel[0]]))
        return np.array(states)

    def gap(self, one: np.ndarray, other: np.ndarray) -> float:
        """Largest difference of the positions of two runs in terms of what the effect does to them."""
        q = self.model.nq
        return float(np.abs(one - other)[:, :q].max() / np.abs(one - self.nominal())[:, :q].max())


def _timestep(model: mujoco.MjModel, name: str) -> np.ndarray:
    return np.array(model.opt.timestep) if name == "opt.timestep" else getattr(model, name)


@pytest.fixture
def bench() -> Bench:
    return Bench()
