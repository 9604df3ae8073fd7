from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.physics.two_masses import JOINT, ROTOR, nominal, swings, two_masses, with_springs
from torch_activegp.physics import Step
from torch_activegp.physics.backlash import Backlash, DampedBacklash
from torch_activegp.physics.motor_side import (
    MotorSideBacklash,
    MotorSideDampedBacklash,
    MotorSideSpringyBacklash,
    MotorSideSpringyDampedBacklash,
)

STEP = 0.001


@pytest.mark.parametrize("gap", [0.03, 0.1])
@pytest.mark.parametrize("kind", [MotorSideBacklash, MotorSideDampedBacklash])
def test_the_encoder_sees_the_rotor_between_its_stops(bench: Any, gap: float, kind: type[Backlash]) -> None:
    machine = dataclasses.replace(bench, xml=nominal(STEP), start=(0.0,), control=swings(STEP))
    begin = (-0.5 * gap, 0.0)  # the first torque is positive
    fine = np.repeat(machine.control, 10, axis=0)
    load, rotor = two_masses(bench, gap, 1e-4, 0.0, fine, begin, issubclass(kind, DampedBacklash))[9::10].T
    found, velocity = machine.hooks(kind.at(JOINT, machine.model), [gap]).T
    off = np.abs(found - rotor)  # some, for the stops of MuJoCo give way
    assert off.mean() < 0.1 * np.abs(found - load).mean()
    assert off.max() < 0.2 * np.abs(found - load).max()
    slope = (found[2:] - found[:-2]) / (2 * STEP)
    assert np.abs(velocity[1:-1] - slope).mean() < 0.02 * velocity.std()


@pytest.mark.parametrize("kind", [MotorSideSpringyBacklash, MotorSideSpringyDampedBacklash])
def test_the_encoder_sees_the_rotor_on_its_springs(bench: Any, kind: type[Backlash]) -> None:
    gap, stiffness, damping = 0.1, ROTOR * 40.0**2, 2 * ROTOR * 40.0
    machine = dataclasses.replace(bench, xml=nominal(STEP), start=(0.0,), control=swings(STEP))
    begin = (-0.5 * gap - 2.0 * machine.control[0, 0] / stiffness, 0.0)
    damped = kind is MotorSideSpringyDampedBacklash
    rotor = with_springs(gap, stiffness, damping, machine.control, damped, begin)[:, 1]
    found = machine.hooks(kind.at(JOINT, machine.model), [gap, stiffness, damping])[:, 0]
    assert np.abs(found - rotor).max() < 0.05 * gap


def test_the_joint_begins_behind_its_motor() -> None:
    effect = MotorSideBacklash.at(JOINT, mujoco.MjModel.from_xml_string(nominal(STEP)))
    fields = {name: np.zeros((2, 1)) for name in ("dof_armature", "dof_M0")}
    q, v = np.full((2, 1), 0.5), np.full((2, 1), 3.0)
    step = Step(q, v, np.array([[0.1], [-0.1]]), np.zeros((2, 1)), fields.__getitem__, np.full(2, STEP))
    memory = effect.memory(np.zeros((1, 9)), np.zeros((2, 2), dtype=int), np.full((2, 1), 0.2))
    effect.before_step(step, np.arange(2), np.full((2, 1), 0.2), memory)
    np.testing.assert_allclose(q[:, 0], [0.4, 0.6])
    np.testing.assert_allclose(v[:, 0], 3.0)
    qpos, qvel = q.copy(), v.copy()
    effect.show(qpos, qvel, np.arange(2), np.full((2, 1), 0.2), memory)
    np.testing.assert_allclose(qpos[:, 0], 0.5, atol=0.01 * STEP)


def test_only_the_plain_form_is_looked_for_by_itself(bench: Any) -> None:
    model = mujoco.MjModel.from_xml_string(nominal(STEP))
    kinds = (MotorSideBacklash, MotorSideDampedBacklash, MotorSideSpringyBacklash, MotorSideSpringyDampedBacklash)
    made = [kind.at(JOINT, model) for kind in kinds]
    assert [effect.stands_in for effect in made] == [False, True, True, True]
    assert len({effect.variant for effect in made}) == len(made)
    assert {effect.key for effect in made} == {("backlash", "joint:load")}
    assert not any(effect.centred for effect in made)
