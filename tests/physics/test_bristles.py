from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from torch_activegp.physics.bristles import BRISTLED, BristledCoulomb, BristledStribeck, bent, push
from torch_activegp.physics.friction import CoulombFriction, StribeckFriction

CASES = [
    (BristledCoulomb, CoulombFriction, [0.4], [800.0, 2.0]),
    (BristledStribeck, StribeckFriction, [0.3, 0.2, 0.5], [800.0, 2.0]),
]
STUCK = """
<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="b"><joint name="j" axis="0 1 0"/>
<geom size=".1" mass="1"/></body></worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>"""


def names(case: Any) -> str:
    return getattr(case, "__name__", "")


@pytest.mark.parametrize(("kind", "_", "levels", "bristles"), CASES, ids=names)
def test_the_models_file_does_the_same(bench: Any, kind: Any, _: Any, levels: Any, bristles: Any) -> None:
    """MuJoCo has LuGre's friction in its DC motor."""
    effect, values = kind.at(bench.shoulder, bench.model), [*levels, *bristles]
    assert bench.gap(bench.hooks(effect, values), bench.written(effect, values)) < 0.02


@pytest.mark.parametrize(("kind", "firm", "levels", "bristles"), CASES, ids=names)
def test_stiff_bristles_are_the_firm_law(bench: Any, kind: Any, firm: Any, levels: Any, bristles: Any) -> None:
    one, other = kind.at(bench.shoulder, bench.model), firm.at(bench.shoulder, bench.model)
    stiff = [one.parameters[-2].high, 20.0]
    assert bench.gap(bench.hooks(one, [*levels, *stiff]), bench.hooks(other, levels)) < 0.05
    assert one.key == other.key
    assert one.stands_in
    assert not other.stands_in
    np.testing.assert_allclose(one.taking_over(other, np.array(levels))[: len(levels)], levels)
    assert set(one.describe(np.array([*levels, *stiff]))) == {*other.describe(np.array(levels)), "stiffness", "damping"}


@pytest.mark.parametrize(("kind", "_", "levels", "bristles"), CASES, ids=names)
def test_a_joint_that_is_held_goes_as_far_as_its_bristles_bend(
    bench: Any, kind: Any, _: Any, levels: Any, bristles: Any
) -> None:
    machine = dataclasses.replace(bench, xml=STUCK, start=(0.0,), control=np.full((3000, 1), 0.15))
    effect = kind.at(dataclasses.replace(machine.shoulder, target="joint:j"), machine.model)
    level = levels[0] + (levels[1] if len(levels) > 1 else 0.0)
    states = machine.hooks(effect, [*levels, 40.0, 1.0])
    assert 0.15 / 40.0 < abs(states[-1, 0]) < level / 40.0
    free = dataclasses.replace(machine, control=np.zeros((3000, 1)), start=(0.0,))
    assert free.hooks(effect, [*levels, 40.0, 1.0])[-1, 0] == 0.0


def test_bristles_bend_as_the_law_says() -> None:
    """z' = v - |v| k z / g, integrated by another hand, along a motion that turns back."""
    k, d, g, dt = 300.0, 4.0, 0.5, 1e-4
    time = np.arange(0.0, 1.0, dt)
    position = 5e-3 * np.sin(2 * np.pi * time)
    speed = lambda t: 5e-3 * 2 * np.pi * np.cos(2 * np.pi * t)  # noqa: E731
    solved = solve_ivp(
        lambda t, z: speed(t) - np.abs(speed(t)) * k * z / g, (0.0, 1.0), [0.0], t_eval=time, rtol=1e-9, atol=1e-12
    ).y[0]
    slope = speed(time) - np.abs(speed(time)) * k * solved / g
    memory, pushed = np.array([[0.0, np.nan]]), []
    for q in position:
        pushed.append(push(memory, np.array([q]), np.array([g]), np.array([[k, d]]), np.array([dt]), 1e3)[0])
    np.testing.assert_allclose(pushed[1:], (k * solved + d * slope)[1:], atol=0.01 * g)


def test_bristles_begin_as_the_recording_bent_them() -> None:
    k, g = 500.0, 0.5
    there, back = np.linspace(0.0, 0.05, 60), np.linspace(0.05, 0.0, 60)
    positions = np.stack([np.concatenate([there, back]), np.full(120, 0.3)])
    starts = np.array([[0, 50], [0, 110], [1, 60], [0, 0]])
    found = bent(positions, starts, np.full(4, g), np.full(4, k))
    np.testing.assert_allclose(found[:, 0], [g / k, -g / k, 0.0, 0.0], rtol=1e-6)
    assert np.isnan(found[:, 1]).all()


@pytest.mark.parametrize("kind", BRISTLED)
def test_what_bends_far_is_a_hysteresis(bench: Any, kind: Any) -> None:
    effect = kind.at(bench.shoulder, bench.model)
    values = effect.seeds[0].copy()
    level = float(effect.level(0.0, values))
    for share, may in ((0.5, True), (2.0, False)):
        values[-2] = level / (share * 2e-3 * 1.4)  # of a range of 1.4 rad
        assert effect.plausible(values) is may


@pytest.mark.parametrize(("kind", "_", "levels", "bristles"), CASES, ids=names)
def test_bristles_have_the_friction_that_the_model_has_already(
    bench: Any, kind: Any, _: Any, levels: Any, bristles: Any
) -> None:
    own = bench.xml.replace('<joint name="shoulder"', '<joint name="shoulder" frictionloss="0.1"')
    rubbing = dataclasses.replace(bench, xml=own, shoulder=dataclasses.replace(bench.shoulder, loss=0.1))
    less = [levels[0] - 0.1, *levels[1:], *bristles]
    effect = kind.at(rubbing.shoulder, rubbing.model)
    wanted = bench.hooks(kind.at(bench.shoulder, bench.model), [*levels, *bristles])
    np.testing.assert_allclose(rubbing.hooks(effect, less), wanted, atol=1e-9)
    assert bench.gap(rubbing.written(effect, less), wanted) < 0.02


def test_what_is_no_friction_is_not_written(bench: Any) -> None:
    own = bench.xml.replace('<joint name="shoulder"', '<joint name="shoulder" frictionloss="0.1"')
    rubbing = dataclasses.replace(bench, xml=own, shoulder=dataclasses.replace(bench.shoulder, loss=0.1))
    for kind, _, levels, bristles in CASES:
        effect = kind.at(rubbing.shoulder, rubbing.model)
        assert not effect.write(mujoco.MjSpec.from_string(own), np.array([-0.1, *levels[1:], *bristles]))


def test_bristles_are_no_stiffer_than_a_time_step_allows() -> None:
    dt, inertia = np.array([5e-3]), 0.1
    memory = np.array([[1e-3, 0.2]])
    held = push(memory, np.array([0.2]), np.array([1e6]), np.array([[1e9, 1e9]]), dt, inertia)
    assert held[0] == pytest.approx(0.5 * inertia / dt[0] ** 2 * 1e-3)
    moved = push(memory, np.array([0.201]), np.array([1e6]), np.array([[0.1, 1e9]]), dt, inertia)
    assert moved[0] == pytest.approx(0.5 * inertia / dt[0] * 1e-3 / dt[0], rel=1e-3)
