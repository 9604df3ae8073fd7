from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.physics.two_masses import JOINT, ROTOR, nominal, seen, swings, with_springs
from torch_activegp.physics import Step
from torch_activegp.physics.backlash import Backlash
from torch_activegp.physics.motor_side import MotorSideSpringyBacklash
from torch_activegp.physics.rotor import Past
from torch_activegp.physics.springy_backlash import SpringyBacklash, SpringyDampedBacklash

CLOSE = 2e-3
"""Of the motion."""


@pytest.mark.parametrize(
    ("frequency", "damped", "kind"),
    [(40.0, 1.0, SpringyBacklash), (80.0, 0.3, SpringyBacklash), (40.0, 1.0, SpringyDampedBacklash)],
)
def test_ends_that_give_way_are_springs_and_dampers(
    bench: Any, frequency: float, damped: float, kind: type[SpringyBacklash]
) -> None:
    machine = dataclasses.replace(bench, xml=nominal(0.001), start=(0.0,), control=swings(0.001))
    effect, gap = kind.at(JOINT, machine.model), 0.1
    stiffness, damping = ROTOR * frequency**2, 2 * damped * ROTOR * frequency
    fine = dataclasses.replace(machine, xml=nominal(1e-4), control=np.repeat(machine.control, 10, axis=0))
    moved = with_springs(gap, stiffness, damping, machine.control, kind is SpringyDampedBacklash)[:, 0]
    wanted = moved - fine.nominal()[9::10, 0]
    before = machine.nominal()[:, 0]
    found = machine.hooks(effect, [gap, stiffness, damping])[:, 0] - before
    firm = machine.hooks(Backlash.at(JOINT, machine.model), [gap])[:, 0] - before
    assert np.abs(found - wanted).max() < 0.08 * np.abs(wanted).max()
    assert np.abs(found - wanted).max() < 0.3 * np.abs(firm - wanted).max()


def test_ends_as_firm_as_they_may_be_are_firm(bench: Any) -> None:
    machine = dataclasses.replace(bench, xml=nominal(0.001), start=(0.0,), control=swings(0.001))
    firm, springy = (kind.at(JOINT, machine.model) for kind in (Backlash, SpringyBacklash))
    gap = np.array([0.1])
    stiff = springy.absent(springy.taking_over(firm, gap))
    found, wanted = machine.hooks(springy, [0.1, *stiff[1:]])[:, 0], machine.hooks(firm, gap)[:, 0]
    assert (found - wanted).std() < 0.1 * (wanted - machine.nominal()[:, 0]).std()
    begun = springy.taking_over(firm, gap)
    assert begun[0] == 0.1
    np.testing.assert_array_equal(begun[1:], springy.seeds[0, 1:])
    np.testing.assert_array_equal(firm.taking_over(springy, begun), gap)


def test_a_springy_rotor_begins_pressed_against_its_end_where_it_has_been_there(bench: Any) -> None:
    effect = SpringyBacklash.at(dataclasses.replace(JOINT, dt=0.1), mujoco.MjModel.from_xml_string(nominal(0.001)))
    t = 0.1 * np.arange(20)[None]
    past = Past(t, np.zeros(1), lambda some, back: np.full((1, back, 1), 0.5))
    memory = effect.memory(0.5 * 15.0 * t**2, np.array([[0, 10]]), np.array([[0.2, 50.0, 0.0]]), past)
    fields = {name: np.zeros((1, 1)) for name in ("dof_armature", "dof_M0")}
    q, v, force = np.zeros((1, 1)), np.zeros((1, 1)), np.zeros((1, 1))
    step = Step(q, v, np.full((1, 1), 0.5), force, fields.__getitem__, np.full(1, 1e-3))
    effect.before_step(step, np.arange(1), np.array([[0.2, 50.0, 0.0]]), memory)
    goes_through = 1.0 - 15.0 * ROTOR  # of the motor's torque, the rest speeds up the rotor
    assert memory[0, 0] == pytest.approx(0.1 + goes_through / 50.0, abs=1e-4)
    assert force[0, 0] == pytest.approx(goes_through - 1.0)


@pytest.mark.parametrize("middle", [0.0, 0.5])
@pytest.mark.parametrize("light", [1.0, 1e-3])
def test_a_light_joint_behind_a_springy_rotor_stays_stable(light: float, middle: float) -> None:
    """As firm as they may be, at steps of 5 ms, on a joint of a thousandth of the rotor's inertia too."""
    xml = f"""<mujoco><option timestep="0.005" integrator="{"RK4" if middle else "implicitfast"}" gravity="0 0 0"/>
    <worldbody><body><joint name="load" axis="0 1 0" armature="{ROTOR}"/>
    <inertial pos="0 0 0" mass="1" diaginertia="{light * ROTOR} {light * ROTOR} {light * ROTOR}"/></body></worldbody>
    <actuator><motor joint="load" gear="2"/></actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    effect = SpringyBacklash.at(dataclasses.replace(JOINT, dt=0.005), model)
    values, rows = np.array([[0.05, *effect.absent(effect.seeds[0])[1:]]]), np.array([0])
    memory = effect.memory(np.zeros((1, 3)), np.zeros((1, 2), dtype=int), values)
    data, seen = mujoco.MjData(model), []
    effect.edit(lambda name: getattr(model, name)[None], rows, values)
    for control in swings(0.005)[:, 0]:
        data.ctrl[0] = control
        data.qfrc_applied[:] = 0.0
        views = (each[None] for each in (data.qpos, data.qvel, data.ctrl, data.qfrc_applied))
        effect.before_step(Step(*views, lambda name: np.zeros((1, 1)), np.full(1, 0.005), middle), rows, values, memory)
        mujoco.mj_step(model, data)
        seen.append(data.qvel[0])
    firm = 2.0 * np.cumsum(swings(0.005)[:, 0]) * 0.005 / (ROTOR * (1.0 + light))
    assert np.abs(seen).max() < 1.5 * np.abs(firm).max()
    assert not np.isnan(seen).any()


@pytest.mark.parametrize("frequency", [80.0, 300.0])
@pytest.mark.parametrize("integrator", ["implicitfast", "RK4"])
@pytest.mark.parametrize("kind", [SpringyBacklash, MotorSideSpringyBacklash])
def test_in_long_steps_the_rotor_moves_in_short_ones(frequency: float, integrator: str, kind: Any) -> None:
    """Steps of 4 ms, a third and more than one radian of the natural frequency."""
    step, gap, middle = 0.004, 0.1, 0.5 * (integrator == "RK4")
    values = [gap, ROTOR * frequency**2, 0.6 * ROTOR * frequency]
    xml = nominal(step).replace("<option", f'<option integrator="{integrator}"')
    control = swings(step)
    effect = kind.at(dataclasses.replace(JOINT, dt=step), mujoco.MjModel.from_xml_string(xml))
    behind = 0.5 * gap + 2.0 * control[0, 0] / values[1] if effect.on_motor else 0.0
    truth = with_springs(*values, control, begin=(-behind, 0.0), step=step)
    wanted, (found, speed) = truth[:, int(effect.on_motor)], seen(effect, values, control, xml, middle).T
    assert np.abs(found - wanted).max() < CLOSE * np.ptp(wanted)
    slope = np.gradient(wanted, step)
    early = 0.5 * step * np.gradient(slope, step) * (middle == 0.0)  # speeds of the scheme belong to half a step before
    off = np.abs(speed - slope + early)[2:-2].mean() / slope.std()
    assert off < 0.05


@pytest.mark.parametrize("middle", [0.0, 0.5])
@pytest.mark.parametrize("share", [0.25, 4.0])
@pytest.mark.parametrize("frequency", [80.0, 600.0])
def test_a_joint_with_another_inertia_than_foreseen_stays_stable(frequency: float, share: float, middle: float) -> None:
    """A folded arm has a quarter of what it has stretched."""
    step, control = 0.004, swings(0.004)
    xml = nominal(step).replace("<option", f'<option integrator="{"RK4" if middle else "implicitfast"}"')
    effect = SpringyBacklash.at(dataclasses.replace(JOINT, dt=step), mujoco.MjModel.from_xml_string(xml))
    wrong = dataclasses.replace(effect, load=effect.load / share)
    for rotor in (ROTOR, 10.0 * ROTOR):
        values = [0.1, rotor * frequency**2, 0.6 * rotor * frequency]
        model = nominal(step, armature=rotor)
        right, found = (
            seen(dataclasses.replace(some, rotor=rotor, armature=rotor), values, control, model, middle)[:, 0]
            for some in (effect, wrong)
        )
        assert np.abs(found - right).max() < 0.1 * np.ptp(right)


def test_a_simulation_is_alike_whatever_the_others(bench: Any) -> None:
    effect = SpringyBacklash.at(JOINT, mujoco.MjModel.from_xml_string(nominal(0.004)))
    values = np.array([[0.1, ROTOR * 80.0**2, 0.5], [0.1, ROTOR * 500.0**2, 0.5], [0.1, np.nan, 0.5]])
    dt = np.array([0.004, 0.008, 0.004])

    def pushed(which: list[int]) -> np.ndarray:
        count = len(which)
        memory = np.tile([0.06, 0.3, 0.0, 0.0, 0.0, 0.004], (count, 1))
        state = np.zeros((count, 1)), np.full((count, 1), 0.1), np.ones((count, 1)), np.zeros((count, 1))
        effect.before_step(Step(*state, lambda name: np.zeros(1), dt[which]), np.arange(count), values[which], memory)
        return np.column_stack([memory, state[3]])

    together = pushed([0, 1, 2])
    np.testing.assert_array_equal(together[:1], pushed([0]))
    np.testing.assert_array_equal(together[1:2], pushed([1]))


def test_a_rotor_may_be_heavier_than_what_it_moves() -> None:
    """On a slide ``dof_invweight0`` knows nothing of the armature."""
    xml = """<mujoco><worldbody><body><joint name="load" type="slide" axis="1 0 0" armature="5"/>
    <geom type="box" size=".1 .1 .1" mass="4"/></body></worldbody><actuator><motor joint="load"/></actuator></mujoco>"""
    effect = SpringyBacklash.at(JOINT, mujoco.MjModel.from_xml_string(xml))
    assert (effect.rotor, effect.load) == (5.0, pytest.approx(4.0))
    assert effect.light == pytest.approx(20.0 / 9.0)
