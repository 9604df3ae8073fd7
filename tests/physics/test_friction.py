from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics.drag import AsymmetricFriction, QuadraticDrag, ViscousFriction
from torch_activegp.physics.friction import FRICTION, AsymmetricCoulomb, CoulombFriction, StribeckFriction, sticking
from torch_activegp.physics.place import Place
from torch_activegp.physics.soft_friction import SoftCoulombFriction

# effect, values, how far the law as a plain force and the model's file may be from it, in parts of its effect
CASES = [
    (ViscousFriction, [0.2], 0.01, 1e-3),
    (QuadraticDrag, [0.1], 0.01, 1e-3),
    (CoulombFriction, [0.4], 0.05, 1e-3),
    (AsymmetricFriction, [0.3, 0.1], 0.01, None),
    (AsymmetricCoulomb, [0.5, 0.2], 0.05, 1e-3),
    (StribeckFriction, [0.3, 0.3, 0.5], 0.05, 0.05),
]
STUCK = """
<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="b"><joint name="j" axis="0 1 0"/>
<geom size=".1" mass="1"/></body></worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>"""


def test_the_cases_are_the_family() -> None:
    assert {case[0] for case in CASES} == set(FRICTION)


@pytest.mark.parametrize(("kind", "values", "near", "_"), CASES, ids=lambda x: getattr(x, "__name__", ""))
def test_the_law_as_a_force_does_the_same(bench: Any, kind: Any, values: Any, near: float, _: Any) -> None:
    effect = kind.at(bench.shoulder, bench.model)
    assert bench.gap(bench.hooks(effect, values), bench.force(effect, values)) < near


@pytest.mark.parametrize(("kind", "values", "_", "near"), CASES, ids=lambda x: getattr(x, "__name__", ""))
def test_the_models_file_does_the_same(bench: Any, kind: Any, values: Any, _: Any, near: float | None) -> None:
    effect = kind.at(bench.shoulder, bench.model)
    if near is None:
        assert not effect.write(bench.spec, np.array(values))
    else:
        assert bench.gap(bench.hooks(effect, values), bench.written(effect, values)) < near


@pytest.mark.parametrize(("kind", "values", "_", "__"), CASES, ids=lambda x: getattr(x, "__name__", ""))
def test_friction_takes_energy_away(bench: Any, kind: Any, values: Any, _: Any, __: Any) -> None:
    effect = kind.at(bench.shoulder, bench.model)
    velocity = np.linspace(-3.0, 3.0, 60)
    assert (effect.force(0.0 * velocity, velocity, values) * velocity < 0.0).all()
    smooth = bench.xml.replace('"0.05"', '"0"').replace('"0.02"', '"0"')
    swing = dataclasses.replace(bench, xml=smooth, start=(1.2, 0.0), control=np.zeros((700, 2)))
    effect = kind.at(swing.shoulder, swing.model)
    assert energy(swing, swing.hooks(effect, values)) < energy(swing, swing.nominal()) - 0.05


def energy(machine: Any, states: np.ndarray) -> float:
    """Kinetic and potential energy at the end, without the servo's."""
    model = machine.model
    model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = np.split(states[-1], 2)
    mujoco.mj_forward(model, data)
    return float(data.energy.sum())


@pytest.mark.parametrize(
    ("kind", "values", "load"),
    [
        (CoulombFriction, [0.4], 0.3),
        (AsymmetricCoulomb, [0.5, 0.1], 0.45),
        (AsymmetricCoulomb, [0.1, 0.5], -0.45),
        (StribeckFriction, [0.2, 0.3, 0.5], 0.4),
    ],
)
@pytest.mark.parametrize("over", [False, True])
def test_dry_friction_sticks_up_to_its_level(bench: Any, kind: Any, values: Any, load: float, over: bool) -> None:
    pushed = np.full((500, 1), 1.5 * load if over else load)
    machine = dataclasses.replace(bench, xml=STUCK, start=(0.0,), control=pushed)
    moved = abs(
        machine.hooks(kind.at(dataclasses.replace(machine.shoulder, target="joint:j"), machine.model), values)[-1, 0]
    )
    assert moved > 0.1 if over else moved < 2e-3


def test_what_comes_on_top_cannot_make_a_loss_negative(bench: Any) -> None:
    model = bench.model
    model.dof_frictionloss[0] = 0.3
    assert CoulombFriction.at(bench.shoulder, model).parameters[0].low == -0.3
    assert StribeckFriction.at(bench.shoulder, model).parameters[0].low == -0.3


@pytest.mark.parametrize(("own", "tuned"), [(0.0, False), (0.02, True)])
def test_a_level_that_the_model_has_may_be_tuned(own: float, tuned: bool) -> None:
    model = mujoco.MjModel.from_xml_string(STUCK.replace('axis="0 1 0"', f'axis="0 1 0" frictionloss="{own}"'))
    assert CoulombFriction.at(Place("joint:j", 0), model).tunable is tuned
    for other in (SoftCoulombFriction, AsymmetricCoulomb):  # another form of it, and more than a modeller has
        assert not other.at(Place("joint:j", 0), model).tunable


def test_dry_friction_by_direction_is_a_steady_force_beside_coulombs(bench: Any) -> None:
    """Nothing stops its simulations at every step: they are made in one call."""
    effect = AsymmetricCoulomb.at(bench.shoulder, bench.model)
    force = np.zeros((2, bench.model.nv))
    effect.steady(force, np.array([1]), np.array([[0.5, 0.2]]))
    assert not effect.needs_steps
    assert force[1, effect.dof] == pytest.approx(-0.15)
    assert np.count_nonzero(force) == 1


def test_stribeck_is_described_by_its_two_levels(bench: Any) -> None:
    effect = StribeckFriction.at(bench.shoulder, bench.model)
    assert effect.describe(np.array([0.3, 0.2, 0.5])) == {"coulomb": 0.3, "static": 0.5, "velocity": 0.5}
    assert effect.covers == ("coulomb_friction",)
    assert not effect.write(bench.spec, np.array([0.0, 0.2, 0.5]))


@pytest.mark.parametrize("softness", ["", 'solreffriction="-10000 -200"'])
def test_the_models_own_friction_can_stick_firmly(softness: str) -> None:
    """MuJoCo's default lets it creep, and so do a stiffness and a damping that are written instead of a time."""
    soft = mujoco.MjModel.from_xml_string(STUCK.replace('name="j"', f'name="j" frictionloss="0.4" {softness}'))
    crept = []
    for model in (soft, sticking(soft, 0.001)):
        data = mujoco.MjData(model)
        data.ctrl[0] = 0.3
        mujoco.mj_step(model, data, 500)
        crept.append(abs(data.qpos[0]))
    assert crept[1] < 0.1 * crept[0]
    assert crept[1] < 5e-4
    assert not soft.dof_solimp[0, 0] == sticking(soft, 0.001).dof_solimp[0, 0]
    assert np.array_equal(sticking(soft, 0.001).dof_solref[0], [0.002, 1.0])
    free = mujoco.MjModel.from_xml_string(STUCK)
    assert np.array_equal(sticking(free, 0.001).dof_solref, free.dof_solref)


@pytest.mark.parametrize(
    ("sliding", "sticking", "real"), [(0.01, 0.14, True), (0.01, 0.199, True), (0.01, 0.201, False), (0.0, 0.1, False)]
)
def test_what_sticks_slides_with_friction_too(bench: Any, sliding: float, sticking: float, real: bool) -> None:
    """A boom stood in its bearing by 14 times what it slid by; without that it was `none` at 1.17 times the noise."""
    effect = StribeckFriction.at(bench.shoulder, bench.model)
    assert effect.plausible(np.array([sliding, sticking - sliding, 0.15])) is real
