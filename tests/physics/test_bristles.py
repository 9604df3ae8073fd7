from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from torch_activegp.physics.bristles import (
    BRISTLED_FORMS,
    BristledCoulomb,
    BristledStribeck,
    _within_steps,
)
from torch_activegp.physics.effect import Step
from torch_activegp.physics.friction import CoulombFriction, StribeckFriction

CASES = [
    (BristledCoulomb, CoulombFriction, [0.4]),
    (BristledStribeck, StribeckFriction, [0.3, 0.2, 0.5]),
]
STUCK = """
<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="b"><joint name="j" axis="0 1 0"/>
<geom size=".1" mass="1"/></body></worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>"""


def names(case: Any) -> str:
    return getattr(case, "__name__", "")


def bristles(effect: Any, frequency: float, damped: float = 0.3) -> list[float]:
    """Stiffness and damping by which the joint swings on its bristles, at rad/s."""
    return [effect.inertia * frequency**2, 2.0 * damped * effect.inertia * frequency]


@pytest.mark.parametrize(("kind", "levels"), [(case[0], case[2]) for case in CASES], ids=names)
def test_mujocos_motor_does_the_same_and_is_not_written(bench: Any, kind: Any, levels: Any) -> None:
    """It has LuGre's friction; but its bristles are unbent as a simulation begins, and stiff ones fly apart."""
    effect, spec = kind.at(bench.shoulder, bench.model), bench.spec
    slides, static, speed = (levels[0], sum(levels[:2]), levels[2]) if len(levels) > 1 else (0.4, 0.4, 1.0)
    stiffness, _ = bristles(effect, 150.0)
    assert not effect.write(spec, np.array([*levels, stiffness, 0.0]))
    effect.add_passive(spec, lugre=[stiffness, 0.0, slides, static, speed])
    spec.compile()
    motor = bench.run(mujoco.MjModel.from_xml_string(spec.to_xml()))
    assert bench.gap(bench.hooks(effect, [*levels, stiffness, 0.0]), motor) < 0.02


@pytest.mark.parametrize(("kind", "firm", "levels"), CASES, ids=names)
def test_stiff_bristles_are_the_firm_law(bench: Any, kind: Any, firm: Any, levels: Any) -> None:
    one, other = kind.at(bench.shoulder, bench.model), firm.at(bench.shoulder, bench.model)
    stiff = [one.parameters[-2].high, 20.0]
    assert bench.gap(bench.hooks(one, [*levels, *stiff]), bench.hooks(other, levels)) < 0.05
    assert one.key == other.key
    assert one.stands_in
    assert not other.stands_in
    np.testing.assert_allclose(one.taking_over(other, np.array(levels))[: len(levels)], levels)
    assert set(one.describe(np.array([*levels, *stiff]))) == {*other.describe(np.array(levels)), "stiffness", "damping"}


@pytest.mark.parametrize(("kind", "_", "levels"), CASES, ids=names)
def test_a_joint_that_is_held_goes_as_far_as_its_bristles_bend(bench: Any, kind: Any, _: Any, levels: Any) -> None:
    machine = dataclasses.replace(bench, xml=STUCK, start=(0.0,), control=np.full((3000, 1), 0.15))
    effect = kind.at(dataclasses.replace(machine.shoulder, target="joint:j"), machine.model)
    level = sum(levels[:2]) if len(levels) > 1 else levels[0]
    states = machine.hooks(effect, [*levels, 40.0, 1.0])
    assert 0.15 / 40.0 < abs(states[-1, 0]) < level / 40.0
    free = dataclasses.replace(machine, control=np.zeros((3000, 1)))
    assert free.hooks(effect, [*levels, 40.0, 1.0])[-1, 0] == 0.0


def pushes(effect: Any, values: Any, position: np.ndarray, dt: float, middle: float = 0.0) -> np.ndarray:
    """The force of the bristles in each step of a motion."""
    speed, row = np.gradient(position, dt), np.array([values])
    memory = effect.memory(np.zeros((1, 1)), np.zeros((1, 2), dtype=int), row)
    return np.array([push(effect, row, memory, q, v, dt, middle) for q, v in zip(position, speed, strict=True)])


def push(effect: Any, values: Any, memory: Any, q: float, v: float, dt: float, middle: float = 0.0) -> float:
    """The force of the bristles in one step."""
    force = np.zeros((1, 1))
    step = Step(np.full((1, 1), q), np.full((1, 1), v), force, force, lambda _: force, np.array([dt]), middle)
    effect.before_step(step, np.array([0]), values, memory)
    return float(force[0, 0])


@pytest.mark.parametrize("middle", [0.0, 0.5])
@pytest.mark.parametrize(("kind", "levels"), [(case[0], case[2]) for case in CASES], ids=names)
def test_bristles_bend_as_the_law_says(bench: Any, kind: Any, levels: Any, middle: float) -> None:
    """z' = v - |v| k z / g, integrated by another hand, along a motion that turns back; at once or half a step on."""
    effect, dt = dataclasses.replace(kind.at(bench.shoulder, bench.model), inertia=1e3), 1e-3
    k, d = 300.0, 4.0
    time = np.arange(0.0, 1.0, dt)

    def speed(t: Any) -> Any:
        return 5e-3 * 2 * np.pi * np.cos(2 * np.pi * t)

    def slope(t: Any, z: Any) -> Any:
        return speed(t) - np.abs(speed(t)) * k * z / effect.level(speed(t), np.array([*levels, k, d]))

    solved = solve_ivp(slope, (0.0, 1.1), [0.0], dense_output=True, rtol=1e-9, atol=1e-12, max_step=1e-3).sol
    there = time + middle * dt
    wanted = -np.array([k * solved(t)[0] + d * slope(t, solved(t)[0]) for t in there])
    found = pushes(effect, [*levels, k, d], 5e-3 * np.sin(2 * np.pi * time), dt, middle)
    late = np.abs(found - wanted)[5:]
    assert late.max() < 0.02 * sum(levels[:1])
    other = -np.array([k * solved(t)[0] + d * slope(t, solved(t)[0]) for t in time + (0.5 - middle) * dt])
    assert np.mean(late**2) < np.mean((found - other)[5:] ** 2)


def test_bristles_begin_as_the_run_bent_them(bench: Any) -> None:
    """However long ago: a joint that was held with bristles bent is held by them yet."""
    effect = BristledCoulomb.at(bench.shoulder, bench.model)
    k, g = 500.0, 0.5
    there, back = np.linspace(0.0, 0.05, 400), np.linspace(0.05, 0.0, 400)
    stuck = np.concatenate([np.linspace(0.0, 0.3 * g / k, 50), np.full(750, 0.3 * g / k)])
    positions = np.stack([np.concatenate([there, back]), stuck])
    starts = np.array([[0, 300], [0, 700], [1, 700], [0, 0]])
    found = effect.memory(positions, starts, np.tile([g, k, 1.0], (4, 1)))
    np.testing.assert_allclose(found[:, 0], [g, -g, (1.0 - np.exp(-0.3)) * g, 0.0], rtol=1e-6)
    assert np.isnan(found[:, 1]).all()
    softer = effect.memory(positions, starts[2:3].repeat(2, axis=0), np.array([[g, k, 1.0], [g, 0.5 * k, 1.0]]))
    assert softer[1, 0] == pytest.approx((1.0 - np.exp(-0.15)) * g)


@pytest.mark.parametrize(("kind", "_", "levels"), CASES, ids=names)
def test_a_joint_that_slides_is_held_back_by_the_level_from_the_first_step_on(
    bench: Any, kind: Any, _: Any, levels: Any
) -> None:
    """Also where bristles are stiffer than time steps allow, and where one is longer than the others."""
    effect = kind.at(bench.shoulder, bench.model)
    values = np.array([[*levels, *bristles(effect, 1500.0)]])
    moving = np.linspace(0.0, 6.0, 200)[None]
    memory = effect.memory(moving, np.array([[0, 100]]), values)
    level = float(effect.level(3.0, values[0]))
    for place, dt in ((3.0, 5e-3), (3.015, 1e-2), (3.045, 5e-3)):
        assert push(effect, values, memory, place, 3.0, dt) == pytest.approx(-level, rel=1e-3)


def test_what_is_asked_for_one_step_is_the_firm_law(bench: Any) -> None:
    """From a state alone nobody knows how far bristles are bent; from none a joint would creep, step by step."""
    for kind, firm, levels in CASES:
        effect = kind.at(bench.shoulder, bench.model)
        values = [*levels, *bristles(effect, 150.0)]
        alone = bench.hooks(effect.anew(), values)
        np.testing.assert_allclose(alone, bench.hooks(firm.at(bench.shoulder, bench.model), levels), atol=1e-12)


@pytest.mark.parametrize("kind", BRISTLED_FORMS)
def test_what_bends_far_is_a_hysteresis(bench: Any, kind: Any) -> None:
    effect = kind.at(bench.shoulder, bench.model)
    values = effect.seeds[0].copy()
    level = float(effect.level(0.0, values))
    for share, may in ((0.5, True), (2.0, False)):
        values[-2] = level / (share * 2e-3 * 1.4)  # of a range of 1.4 rad
        assert effect.plausible(values) is may


def test_static_friction_alone_is_none_with_bristles_either(bench: Any) -> None:
    effect = BristledStribeck.at(bench.shoulder, bench.model)
    assert effect.plausible(np.array([0.1, 0.2, 0.5, 1e4, 1.0]))
    assert not effect.plausible(np.array([0.001, 0.2, 0.5, 1e4, 1.0]))


def test_a_joint_that_never_turns_back_shows_no_bristles(bench: Any) -> None:
    one_way = dataclasses.replace(bench.shoulder, turns_back=False)
    for kind in BRISTLED_FORMS:
        assert kind.fits(bench.shoulder, bench.model)
        assert not kind.fits(one_way, bench.model)


def test_bristles_know_the_rows_of_the_recording(bench: Any) -> None:
    slow = dataclasses.replace(bench.shoulder, dt=0.04)
    assert [kind.at(slow, bench.model).row for kind in BRISTLED_FORMS] == [0.04, 0.04]


@pytest.mark.parametrize(("kind", "_", "levels"), CASES, ids=names)
def test_bristles_have_the_friction_that_the_model_has_already(bench: Any, kind: Any, _: Any, levels: Any) -> None:
    own = bench.xml.replace('<joint name="shoulder"', '<joint name="shoulder" frictionloss="0.1"')
    rubbing = dataclasses.replace(bench, xml=own, shoulder=dataclasses.replace(bench.shoulder, loss=0.1))
    effect = kind.at(rubbing.shoulder, rubbing.model)
    soft = bristles(effect, 70.0)
    less = [levels[0] - 0.1, *levels[1:], *soft]
    wanted = bench.hooks(kind.at(bench.shoulder, bench.model), [*levels, *soft])
    np.testing.assert_allclose(rubbing.hooks(effect, less), wanted, atol=1e-9)


def test_bristles_are_no_stiffer_than_a_time_step_allows() -> None:
    one, dt, inertia = np.ones(1), np.array([5e-3]), 0.1
    stiffness, damping = _within_steps(1e9 * one, 1e9 * one, inertia, dt)
    assert stiffness[0] == pytest.approx(0.5 * inertia / dt[0] ** 2)
    assert damping[0] == pytest.approx(0.5 * inertia / dt[0])
    assert _within_steps(10.0 * one, 0.1 * one, inertia, dt) == (10.0, 0.1)
