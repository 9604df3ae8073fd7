from __future__ import annotations

import numpy as np
import pytest

from torch_activegp.physics.backlash import Backlash
from torch_activegp.physics.cogging import Cogging
from torch_activegp.physics.drag import AsymmetricFriction, QuadraticDrag, ViscousFriction
from torch_activegp.physics.effect import Step
from torch_activegp.physics.friction import CoulombFriction, StribeckFriction
from torch_activegp.physics.held_force import HeldForce
from torch_activegp.physics.inertia import ArmatureError
from torch_activegp.physics.play import Hysteresis
from torch_activegp.physics.springs import CubicSpring, LinearSpring
from torch_activegp.physics.stops import JointStop


def test_what_sticks_strikes_or_remembers_is_not_held(bench) -> None:
    smooth = (ViscousFriction, QuadraticDrag, AsymmetricFriction, LinearSpring, CubicSpring, Cogging)
    others = (CoulombFriction, StribeckFriction, JointStop, Backlash, Hysteresis, ArmatureError)
    for kinds, held in ((smooth, True), (others, False)):
        for kind in kinds:
            assert (HeldForce.like(kind.at(bench.shoulder, bench.model)) is not None) is held, kind


def test_a_held_force_is_of_the_state_that_a_step_begins_with(bench) -> None:
    """Not of where the joint is in the middle of the step."""
    spring = CubicSpring.at(bench.shoulder, bench.model)
    qpos, qvel = np.zeros((1, bench.model.nq)), np.zeros((1, bench.model.nv))
    force, none = np.zeros_like(qvel), np.zeros((1, bench.model.nu))
    qpos[0, spring.qpos], qvel[0, spring.dof] = 0.3, 2.0
    step = Step(qpos, qvel, none, force, lambda name: np.zeros(1), np.array([0.1]), middle=0.5)
    HeldForce.like(spring).before_step(step, np.array([0]), np.array([[2.0]]), None)
    assert force[0, spring.dof] == pytest.approx(-2.0 * 0.3**3)


def test_slopes_are_those_along_a_motion(bench) -> None:
    time = np.linspace(0.0, 10.0, 2001)
    position, velocity = 0.5 * np.sin(3.0 * time), 1.5 * np.cos(3.0 * time)
    for kind, value, expected in (
        (ViscousFriction, [0.2], (0.2, 0.0)),
        (QuadraticDrag, [0.2], (np.sqrt(np.mean((0.4 * velocity) ** 2)), 0.0)),
        (CubicSpring, [2.0], (0.0, np.sqrt(np.mean((6.0 * position**2) ** 2)))),
    ):
        held = HeldForce.like(kind.at(bench.shoulder, bench.model))
        np.testing.assert_allclose(held.slopes(position, velocity, np.array(value)), expected, rtol=1e-3, atol=1e-9)
    still = held.slopes(np.zeros(3), np.zeros(3), np.array([2.0]))
    np.testing.assert_allclose(still, 0.0, atol=1e-9)
