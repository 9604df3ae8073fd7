from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from tests.physics.two_masses import JOINT, ROTOR, nominal, swings, two_masses
from torch_activegp.physics import Step
from torch_activegp.physics.backlash import Backlash, DampedBacklash, RestingBacklash
from torch_activegp.physics.rotor import Past
from torch_activegp.physics.springy_backlash import SpringyBacklash


@pytest.mark.parametrize("gravity", [0.0, -9.81])
@pytest.mark.parametrize(
    ("kind", "begin", "gap"),
    [
        (Backlash, 0.0, 0.03),
        (Backlash, 0.0, 0.15),
        (RestingBacklash, 0.5, 0.03),
        (RestingBacklash, 0.5, 0.15),
        (DampedBacklash, 0.0, 0.03),
        (DampedBacklash, 0.0, 0.06),  # in wider gaps the stops of MuJoCo let the rotor bounce
    ],
)
def test_backlash_is_a_rotor_between_two_stops(
    bench: Any, gap: float, gravity: float, kind: type[Backlash], begin: float
) -> None:
    machine = dataclasses.replace(bench, xml=nominal(0.001, gravity), start=(0.0,), control=swings(0.001))
    effect = kind.at(JOINT, machine.model)
    after, before = machine.hooks(effect, [gap])[:, 0], machine.nominal()[:, 0]
    fine = dataclasses.replace(machine, xml=nominal(1e-4, gravity), control=np.repeat(machine.control, 10, axis=0))
    moved = two_masses(bench, gap, 1e-4, gravity, fine.control, (0.0, begin * gap), kind is DampedBacklash)[9::10, 0]
    wanted = moved - fine.nominal()[9::10, 0]
    close = 0.05 if begin else 0.08  # what flies at first strikes a stop that gives way a little
    assert np.abs(after - before - wanted).max() < close * np.abs(wanted).max()


def test_without_a_gap_backlash_changes_nothing_and_a_wider_one_changes_more(bench: Any) -> None:
    machine = dataclasses.replace(bench, xml=nominal(0.001), start=(0.0,), control=swings(0.001))
    effect = Backlash.at(JOINT, machine.model)
    runs = [machine.hooks(effect, [gap])[:, 0] for gap in (0.0, 0.02, 0.021, 0.1)]
    changes = [float(np.abs(run - machine.nominal()[:, 0]).max()) for run in runs]
    assert changes[0] < 1e-5
    assert [effect.plausible(np.array([gap])) for gap in (0.0, 1e-6, 1e-3)] == [False, False, True]
    noisy = Backlash.at(dataclasses.replace(JOINT, noise=0.01), machine.model)
    assert [noisy.plausible(np.array([gap])) for gap in (1e-3, 1e-2)] == [False, True]
    assert changes[0] < changes[1] < changes[2] < changes[3]
    slopes = np.diff([machine.hooks(effect, [gap])[-1, 0] for gap in np.linspace(0.02, 0.026, 6)])
    assert np.ptp(slopes) < 0.1 * abs(slopes.mean())  # smooth enough to fit


def test_backlash_needs_motors_and_nothing_else(bench: Any) -> None:
    assert Backlash.fits(bench.shoulder, bench.model)
    assert not Backlash.fits(bench.elbow, bench.model)  # a servo feels the load's position
    bare = mujoco.MjModel.from_xml_string(bench.xml.replace('joint="shoulder"', 'joint="elbow"'))
    assert not Backlash.fits(bench.shoulder, bare)
    limited = bench.xml.replace('gear="2"', 'gear="-2" gainprm="3" forcerange="-1 1"').replace("<motor", "<general")
    effect = Backlash.at(bench.shoulder, mujoco.MjModel.from_xml_string(limited))
    assert effect.drives == ((0, -6.0, 0.0, 2.0),)
    assert effect.rotor == effect.armature == 0.02
    light = Backlash.at(JOINT, mujoco.MjModel.from_xml_string(nominal(0.001, armature=0)))
    assert light.armature == 0.0
    assert light.rotor > 0.0
    assert not effect.write(bench.spec, np.array([0.1]))


def first_step(effect: Backlash, memory: np.ndarray, control: float, gap: float) -> np.ndarray:
    """What the rotor's memory is after one step of its joint at rest at zero."""
    count = len(memory)
    fields = {name: np.zeros((count, 1)) for name in ("dof_armature", "dof_M0")}
    q, v, push = np.zeros((count, 1)), np.zeros((count, 1)), np.full((count, 1), control)
    step = Step(q, v, push, np.zeros((count, 1)), fields.__getitem__, np.full(count, 0.001))
    effect.before_step(step, np.arange(count), np.full((count, 1), gap), memory)
    return memory


def test_a_rotor_at_rest_starts_where_it_must_push(bench: Any) -> None:
    effect = RestingBacklash.at(dataclasses.replace(JOINT, dt=0.1), mujoco.MjModel.from_xml_string(nominal(0.001)))
    t = 0.1 * np.arange(20)
    positions = np.stack([0.5 * 30.0 * t**2, -0.5 * 30.0 * t**2])
    memory = effect.memory(positions, np.array([[0, 0], [0, 10], [1, 19]]), np.full((3, 1), 0.2))
    np.testing.assert_allclose(memory[:, 0], [30.0, 30.0, -30.0])
    first_step(effect, memory, 0.1, 0.2)  # 0.2 N m do not turn the rotor at 30 rad/s2
    np.testing.assert_allclose(memory[:, 0], [-0.1, -0.1, 0.1])
    assert (effect.memory(positions[:, :3], np.array([[1, 0]]), np.full((1, 1), 0.2))[:, 0] == 0.0).all()


@pytest.mark.parametrize("kind", [Backlash, SpringyBacklash])
def test_the_rotor_starts_in_the_middle(bench: Any, kind: type[Backlash]) -> None:
    effect = kind.at(dataclasses.replace(JOINT, dt=0.1), mujoco.MjModel.from_xml_string(nominal(0.001)))
    values = np.tile([0.2, 1e6, 0.0][: len(effect.parameters)], (1, 1))
    memory = effect.memory(np.ones((1, 9)), np.array([[0, 0]]), values)
    np.testing.assert_allclose(memory[:, 1:4], 0.0)
    fields = {name: np.zeros((1, 1)) for name in ("dof_armature", "dof_M0")}
    push = np.zeros((1, 1))
    step = Step(np.ones((1, 1)), np.full((1, 1), 0.5), np.ones((1, 1)), push, fields.__getitem__, np.full(1, 0.001))
    effect.before_step(step, np.arange(1), values, memory)
    assert push[0, 0] == pytest.approx(-2.0)  # the motor's torque turns the rotor alone
    assert memory[0, 0] == pytest.approx(1.0, abs=1e-3)


def test_what_was_recorded_from_the_middle_on_leads_to_where_the_rotor_is(bench: Any) -> None:
    """Pushed for 20 ms from the middle of the gap; what was recorded for longer tells no beginning."""
    effect = Backlash.at(dataclasses.replace(JOINT, dt=0.01), mujoco.MjModel.from_xml_string(nominal(0.001)))
    control, gap = np.full((300, 1), 0.02), 0.2
    past = Past(0.01 * np.arange(301)[None], np.zeros(2), lambda some, back: np.stack([control[-back:]] * len(some)))
    memory = effect.memory(np.zeros((1, 301)), np.array([[0, 2], [0, 300]]), np.full((2, 1), gap), past)
    torque = 2.0 * 0.02
    assert memory[0, 1:4] == pytest.approx([0.5 * torque / ROTOR * 0.02**2, torque / ROTOR * 0.02, 0.0], rel=0.01)
    assert memory[1, 1:4] == pytest.approx([0.5 * gap, 0.0, 1.0])


def test_the_rotor_is_carried_along_the_recording(bench: Any) -> None:
    """Pushed forwards for 0.1 s, then back for 20 ms, with its joint at rest: on its way through the gap."""
    effect = RestingBacklash.at(dataclasses.replace(JOINT, dt=0.01), mujoco.MjModel.from_xml_string(nominal(0.001)))
    rows, gap, torque = 40, 0.2, 4.0
    control = np.where(np.arange(rows) < rows - 2, 0.5 * torque, -0.5 * torque)[:, None]

    past = Past(
        0.01 * np.arange(rows + 1)[None], np.zeros(2), lambda some, back: np.stack([control[-back:]] * len(some))
    )

    starts = np.array([[0, rows], [0, 0]])
    memory = effect.memory(np.zeros((1, rows + 1)), starts, np.full((2, 1), gap), past)
    flown, speed = 0.5 * torque / ROTOR * 0.02**2, torque / ROTOR * 0.02
    np.testing.assert_allclose(memory[0, 1:4], [0.5 * gap - flown, -speed, 0.0], rtol=0.05)
    assert np.isnan(memory[1, 1:4]).all()  # nothing was recorded before
    first_step(effect, memory, -0.5 * torque, gap)
    assert memory[0, 0] == pytest.approx(0.5 * gap - flown, rel=0.05)
    assert memory[0, 4] == 0.0
    assert memory[1, 4] == -1.0


def test_a_failed_simulation_leaves_its_neighbour_alone(bench: Any) -> None:
    machine = dataclasses.replace(bench, xml=nominal(0.001), start=(0.0,), control=swings(0.001))
    effect = Backlash.at(JOINT, machine.model)
    memory = np.full((2, 6), np.nan)
    for _ in range(3):
        fields = {name: np.zeros((2, 1)) for name in ("dof_armature", "dof_M0")}
        q, v, u = np.array([[0.1], [np.nan]]), np.array([[0.5], [np.nan]]), np.ones((2, 1))
        step = Step(q, v, u, np.zeros((2, 1)), fields.__getitem__, np.full(2, 0.001))
        effect.before_step(step, np.arange(2), np.full((2, 1), 0.05), memory)
    assert np.isfinite(memory[0]).all()
    assert fields["dof_armature"][0, 0] == 0.0  # held from the first step on


def test_damping_moves_to_the_rotor_where_there_is_some(bench: Any) -> None:
    model = mujoco.MjModel.from_xml_string(nominal(0.001))
    assert DampedBacklash.fits(JOINT, model)
    effect, values = DampedBacklash.at(JOINT, model), np.array([[0.1]])
    fields = {name: np.array([[ROTOR]]) for name in ("dof_armature", "dof_M0", "dof_damping")}
    effect.edit(fields.__getitem__, np.array([0]), values)
    assert fields["dof_damping"][0, 0] == ROTOR  # until a leapfrog has seen it
    memory = effect.memory(np.zeros((1, 9)), np.array([[0, 0]]), values)
    step = Step(*(np.zeros((1, 1)) for _ in range(4)), fields.__getitem__, np.full(1, 0.001))
    effect.before_step(step, np.array([0]), values, memory)
    assert fields["dof_damping"][0, 0] == pytest.approx(ROTOR - 0.03)
    model.dof_damping[:] = 0.0
    assert not DampedBacklash.fits(JOINT, model)
    assert Backlash.fits(JOINT, model)


@pytest.mark.parametrize("last", [20, 21, 40, 41])
def test_a_recording_begins_where_it_does_whatever_row_a_simulation_begins_at(bench: Any, last: int) -> None:
    """Rows a millisecond apart are taken two by two."""
    effect = Backlash.at(dataclasses.replace(JOINT, dt=0.001), mujoco.MjModel.from_xml_string(nominal(0.001)))
    control, gap = np.full((50, 1), 0.02), 0.2
    past = Past(0.001 * np.arange(51)[None], np.zeros(2), lambda some, back: np.stack([control[:back]] * len(some)))
    memory = effect.memory(np.zeros((1, 51)), np.array([[0, 11], [0, last]]), np.full((2, 1), gap), past)
    flown = 0.5 * 2.0 * 0.02 / ROTOR * (1e-3 * np.array([11, last])) ** 2
    np.testing.assert_allclose(memory[:, 1], flown, rtol=0.2)


def test_a_damped_rotor_is_carried_with_its_drag(bench: Any) -> None:
    model = mujoco.MjModel.from_xml_string(nominal(0.001))
    t = 0.01 * np.arange(301)
    control = np.full((300, 1), 0.5 * (0.03 + 1e-3))  # just more than the drag at 1 rad/s
    past = Past(t[None], np.zeros(1), lambda some, back: control[None, -back:])
    found = [
        kind.at(dataclasses.replace(JOINT, dt=0.01), model).memory(
            t[None], np.array([[0, 300]]), np.full((1, 1), 0.2), past
        )
        for kind in (Backlash, DampedBacklash)
    ]
    assert found[0][0, 1:4] == pytest.approx([0.1, 0.0, 1.0])  # undamped it pushes hard
    assert found[1][0, 1] > -0.1
    weaker = Past(t[None], np.zeros(1), lambda some, back: control[None, -back:] - 2e-3)
    damped = DampedBacklash.at(dataclasses.replace(JOINT, dt=0.01), model)
    assert damped.memory(t[None], np.array([[0, 300]]), np.full((1, 1), 0.2), weaker)[0, 3] == -1.0
    resting = dataclasses.replace(damped, centred=False)
    memory = resting.memory(np.zeros((1, 9)), np.array([[0, 0]]), np.full((1, 1), 0.2))
    fields = {name: np.zeros((1, 1)) for name in ("dof_armature", "dof_M0", "dof_damping")}
    step = Step(*(np.array([[x]]) for x in (0.0, 2.0, 0.01)), np.zeros((1, 1)), fields.__getitem__, np.full(1, 0.001))
    resting.before_step(step, np.arange(1), np.full((1, 1), 0.2), memory)
    assert memory[0, 4] == -1.0  # 0.02 N m do not keep it at 2 rad/s


@pytest.mark.parametrize("damping", [0.5, 2.0])
def test_a_light_rotor_with_much_damping_stays_stable(damping: float) -> None:
    """Without an armature a rotor has a hundredth of the inertia, and loses its speed within a step."""

    def end(kind: type[Backlash], step: float) -> float:
        xml = nominal(step, armature=0.0).replace('damping=".03"', f'damping="{damping}"')
        model = mujoco.MjModel.from_xml_string(xml)
        effect, data = kind.at(JOINT, model), mujoco.MjData(model)
        rows, values = np.array([0]), np.full((1, 1), 0.05)
        memory = effect.memory(np.zeros((1, 3)), np.zeros((1, 2), dtype=int), values)

        def field(name: str) -> np.ndarray:
            return np.asarray(getattr(model, name)[None])

        effect.edit(field, rows, values)
        for control in swings(step)[:, 0]:
            data.ctrl[0] = control
            data.qfrc_applied[:] = 0.0
            views = (each[None] for each in (data.qpos, data.qvel, data.ctrl, data.qfrc_applied))
            effect.before_step(Step(*views, field, np.full(1, step)), rows, values, memory)
            mujoco.mj_step(model, data)
        return float(data.qpos[0])

    assert end(DampedBacklash, 0.005) == pytest.approx(end(DampedBacklash, 2.5e-4), abs=0.02)
