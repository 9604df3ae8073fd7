from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics import Place, Step
from torch_activegp.physics.play import Backlash, Hysteresis

JOINT = Place("joint:load", 0, position=(-1.0, 1.0))
ROTOR = 0.02
WITH_PLAY = """
<mujoco><option timestep="{step}" gravity="0 0 {gravity}"/><worldbody>
<body><joint name="load" axis="0 1 0" damping=".03" armature="{armature}"/>
<geom type="capsule" size=".02" fromto="0 0 0 0 0 -.5" mass="1"/></body>{rotor}</worldbody>{gap}
<actuator><motor joint="{driven}" gear="2"/></actuator></mujoco>"""


def nominal(step: float, gravity: float = 0.0, armature: float = ROTOR) -> str:
    return WITH_PLAY.format(step=step, gravity=gravity, armature=armature, rotor="", gap="", driven="load")


def two_masses(bench: Any, gap: float, step: float, gravity: float, control: np.ndarray) -> np.ndarray:
    """The load's position with the rotor as a body of its own, whose angle to the load has limits."""
    xml = WITH_PLAY.format(
        step=step,
        gravity=gravity,
        armature=0,
        rotor=f'<body><joint name="rotor" axis="0 1 0" armature="{ROTOR}"/><geom size=".001" mass="1e-6"/></body>',
        gap=f'<tendon><fixed limited="true" range="{-gap / 2} {gap / 2}" solreflimit="{2 * step} 1" '
        'solimplimit=".99 .999 .0001"><joint joint="rotor" coef="1"/><joint joint="load" coef="-1"/></fixed></tendon>',
        driven="rotor",
    )
    machine = dataclasses.replace(bench, xml=xml, start=(0.0, 0.5 * gap), control=control)
    return np.asarray(machine.nominal()[:, 0])


def swings(step: float) -> np.ndarray:
    t = np.arange(0.0, 1.5, step)[:, None] * 2 * np.pi
    return np.asarray(0.5 * np.sin(1.3 * t + 0.3) + 0.4 * np.sin(0.47 * t))


@pytest.mark.parametrize("gravity", [0.0, -9.81])
@pytest.mark.parametrize("gap", [0.03, 0.15])
def test_backlash_is_a_rotor_between_two_stops(bench: Any, gap: float, gravity: float) -> None:
    machine = dataclasses.replace(bench, xml=nominal(0.001, gravity), start=(0.0,), control=swings(0.001))
    effect = Backlash.at(JOINT, machine.model)
    after, before = machine.hooks(effect, [gap])[:, 0], machine.nominal()[:, 0]
    fine = dataclasses.replace(machine, xml=nominal(1e-4, gravity), control=np.repeat(machine.control, 10, axis=0))
    wanted = two_masses(bench, gap, 1e-4, gravity, fine.control)[9::10] - fine.nominal()[9::10, 0]
    assert np.abs(after - before - wanted).max() < 0.05 * np.abs(wanted).max()


def test_without_a_gap_backlash_changes_nothing_and_a_wider_one_changes_more(bench: Any) -> None:
    machine = dataclasses.replace(bench, xml=nominal(0.001), start=(0.0,), control=swings(0.001))
    effect = Backlash.at(JOINT, machine.model)
    runs = [machine.hooks(effect, [gap])[:, 0] for gap in (0.0, 0.02, 0.021, 0.1)]
    changes = [float(np.abs(run - machine.nominal()[:, 0]).max()) for run in runs]
    assert changes[0] < 1e-5
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


def test_the_rotor_starts_where_it_must_push(bench: Any) -> None:
    effect = Backlash.at(dataclasses.replace(JOINT, dt=0.1), mujoco.MjModel.from_xml_string(nominal(0.001)))
    t = 0.1 * np.arange(20)
    positions = np.stack([0.5 * 30.0 * t**2, -0.5 * 30.0 * t**2])
    memory = effect.memory(positions, np.array([[0, 0], [0, 10], [1, 19]]), np.full((3, 1), 0.2))
    np.testing.assert_allclose(memory[:, 1], [30.0, 30.0, -30.0])
    fields = {name: np.zeros((3, 1)) for name in ("dof_armature", "dof_M0")}
    q, v, weak = np.zeros((3, 1)), np.zeros((3, 1)), np.full((3, 1), 0.1)  # 0.2 N m do not turn the rotor at 30 rad/s2
    step = Step(q, v, weak, np.zeros((3, 1)), fields.__getitem__, np.full(3, 0.001))
    effect.before_step(step, np.arange(3), np.full((3, 1), 0.2), memory)
    np.testing.assert_allclose(memory[:, 0], [-0.1, -0.1, 0.1])
    assert (effect.memory(positions[:, :3], np.array([[1, 0]]), np.full((1, 1), 0.2))[:, 1] == 0.0).all()


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


def test_hysteresis_is_a_spring_until_it_slips(bench: Any) -> None:
    effect = Hysteresis.at(bench.shoulder, bench.model)
    k, slip, reach = 2.0, 0.1, 0.5
    path = reach * np.sin(np.linspace(0.0, 6 * np.pi, 6001))[None]
    force = effect.path(path, np.array([k, slip]))[0]
    first = path[0] <= slip
    np.testing.assert_allclose(force[: first.argmin()], -k * path[0, : first.argmin()], atol=1e-12)
    assert np.abs(force).max() == pytest.approx(k * slip)
    turn = slice(2000, 4001)
    work = float((0.5 * (force[turn][1:] + force[turn][:-1]) * np.diff(path[0, turn])).sum())
    assert work == pytest.approx(-4 * k * slip * (reach - slip), rel=1e-3)


def test_hysteresis_remembers_the_run_up_to_each_start(bench: Any) -> None:
    effect, rng = Hysteresis.at(bench.shoulder, bench.model), np.random.default_rng(0)
    positions = np.cumsum(0.05 * rng.normal(size=(2, 60)), axis=1)
    starts = np.array([[0, 0], [0, 30], [1, 30], [1, 59]])
    values = np.array([[2.0, 0.1], [2.0, 0.1], [3.0, 0.2], [3.0, 0.1]])
    memory = effect.memory(positions, starts, values)
    for row, (run, at), value in zip(memory, starts, values, strict=True):
        assert -value[0] * row[0] == pytest.approx(effect.path(positions[run : run + 1], value)[0, at])
        assert row[1] == positions[run, at]


def test_hysteresis_in_a_simulation_follows_its_path(bench: Any) -> None:
    effect, values = Hysteresis.at(bench.shoulder, bench.model), np.array([3.0, 0.05])
    states = bench.hooks(effect, values)
    along = effect.path(np.concatenate([[[0.0]], states[None, :-1, 0]], axis=1), values)[0]
    forces = iter(along)

    def before(data: mujoco.MjData) -> None:
        data.qfrc_applied[0] += next(forces)

    np.testing.assert_allclose(bench.run(bench.model, before=before), states, atol=1e-9)
