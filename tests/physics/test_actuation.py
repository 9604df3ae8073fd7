from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics import Place
from torch_activegp.physics.actuation import (
    ACTUATION,
    ActuatorBias,
    ActuatorDeadZone,
    ActuatorDelay,
    ActuatorGain,
    ActuatorLag,
    ActuatorSaturation,
)

CASES = [
    (ActuatorGain, [0.2], 1e-4),
    (ActuatorGain, [-0.3], 1e-4),
    (ActuatorBias, [0.15], 1e-4),
    (ActuatorSaturation, [0.5], 1e-4),
    (ActuatorLag, [0.03], 0.02),
    (ActuatorDelay, [0.02], 1e-3),
    (ActuatorDelay, [0.0137], 1e-3),
    (ActuatorDelay, [0.001], 1e-3),
]


def once(effect: Any, control: np.ndarray, dt: np.ndarray, *values: float) -> np.ndarray:
    """One control of one run after the effect."""
    full = np.repeat(control[:, None], effect.index + 1, axis=1)[None, None].copy()
    assert effect.control(full, dt[None], np.array([values])) is not None
    return np.asarray(full[0, 0, :, effect.index])


@pytest.mark.parametrize("actuator", ["drive", "servo"])
@pytest.mark.parametrize(("kind", "values", "near"), CASES)
def test_the_models_file_does_the_same(bench: Any, kind: Any, values: Any, near: float, actuator: str) -> None:
    effect = kind.at(getattr(bench, actuator), bench.model)
    assert bench.gap(bench.hooks(effect, values), bench.written(effect, values)) < near


def test_no_file_holds_a_dead_zone(bench: Any) -> None:
    assert not ActuatorDeadZone.at(bench.drive, bench.model).write(bench.spec, np.array([0.1]))


def test_no_file_holds_a_delay_below_a_step(bench: Any) -> None:
    assert not ActuatorDelay.at(bench.drive, bench.model).write(bench.spec, np.array([0.0004]))


def test_gain_bias_and_limit_fit_in_one_file_in_any_order(bench: Any) -> None:
    kinds = {ActuatorGain: [0.2], ActuatorBias: [0.15], ActuatorSaturation: [0.8]}
    chain = [(kind.at(bench.drive, bench.model), np.array(values)) for kind, values in kinds.items()]
    control = bench.control[None, None].copy()
    for effect, values in sorted(chain, key=lambda pair: pair[0].order):
        effect.control(control, np.full((1, 1000), 1e-3), values[None])
    wanted = bench.run(bench.model, control[0, 0])
    for order in itertools.permutations(chain):
        spec = bench.spec
        assert all(effect.write(spec, values) for effect, values in order)
        assert bench.gap(wanted, bench.run(spec.compile())) < 1e-9


@pytest.mark.parametrize("kind", [ActuatorGain, ActuatorBias, ActuatorLag])
def test_a_servos_limit_fits_beside_nothing_that_acts_before_it(bench: Any, kind: Any) -> None:
    """Its file limits the control as it comes, not what the drive makes of it."""
    limit, spec = ActuatorSaturation.at(bench.servo, bench.model), bench.spec
    other = kind.at(bench.servo, bench.model)
    assert limit.write(bench.spec, np.array([0.4]))
    assert other.write(spec, other.seeds[0])
    assert not limit.write(spec, np.array([0.4]))


SERVO = '<position name="servo" joint="elbow" kp="5" kv=".2"'
DAMPER = '<damper name="servo" joint="elbow" kv="1" ctrlrange="0 1"'


@pytest.mark.parametrize(
    ("old", "new", "refused"),
    [
        ("<motor", '<general dyntype="filter" dynprm="0.1"', {"lag"}),
        (SERVO, DAMPER, {"gain", "bias", "saturation"}),
        ('kv=".2"', 'dampratio="1"', {"gain", "bias", "saturation"}),
        ('kv=".2"', 'kv=".2" delay="0.01" nsample="11"', {"delay"}),
    ],
)
def test_what_a_file_cannot_hold_is_refused(bench: Any, old: str, new: str, refused: set[str]) -> None:
    machine = dataclasses.replace(bench, xml=bench.xml.replace(old, new))
    place = machine.drive if "general" in new else machine.servo
    found = set()
    for kind in set(ACTUATION) - {ActuatorDeadZone}:
        effect = kind.at(place, machine.model)
        if not effect.write(machine.spec, effect.seeds[0]):
            found.add(effect.name.removeprefix("actuator_"))
    assert found == refused


@pytest.mark.parametrize(("limited", "low"), [("", -0.3), (' forcelimited="false"', -0.5)])
def test_an_existing_limit_stays_where_it_is_narrower(bench: Any, limited: str, low: float) -> None:
    xml = bench.xml.replace('gear="2"', f'gear="2" forcerange="-0.3 5"{limited}')
    spec = mujoco.MjSpec.from_string(xml)
    assert ActuatorSaturation.at(bench.drive, bench.model).write(spec, np.array([0.5]))
    np.testing.assert_array_equal(spec.compile().actuator_forcerange[0], [low, 0.5])


def test_a_limit_leaves_a_drives_own_constant_force_outside(bench: Any) -> None:
    own = bench.xml.replace(
        '<motor name="drive" joint="shoulder" gear="2"/>',
        '<general name="drive" joint="shoulder" gear="2" biastype="affine" biasprm="0.3 0 0"/>',
    )
    machine = dataclasses.replace(bench, xml=own)
    effect, values = ActuatorSaturation.at(machine.drive, machine.model), [0.5]
    assert machine.gap(machine.hooks(effect, values), machine.written(effect, values)) < 1e-4


def test_gain_bias_limit_and_dead_zone_are_their_formulas(bench: Any) -> None:
    u, dt, model = np.linspace(-1.0, 1.0, 9), np.full(9, 0.01), bench.model
    at = {kind: kind.at(bench.servo, model) for kind in ACTUATION}
    np.testing.assert_allclose(once(at[ActuatorGain], u, dt, 0.1), 1.1 * u)
    np.testing.assert_allclose(once(at[ActuatorBias], u, dt, -0.1), u - 0.1)
    np.testing.assert_allclose(once(at[ActuatorSaturation], u, dt, 0.4), np.clip(u, -0.4, 0.4))
    np.testing.assert_allclose(once(at[ActuatorDeadZone], u, dt, 0.3), u - np.clip(u, -0.3, 0.3), atol=1e-15)


@pytest.mark.parametrize("clock", [[0.004, 0.008], [0.006, 0.006]], ids=["irregular", "regular"])
def test_a_lag_is_an_exponential(bench: Any, clock: list[float]) -> None:
    effect, dt = ActuatorLag.at(bench.drive, bench.model), np.tile(clock, 50)
    step = np.r_[0.0, np.ones(99)]
    edges = np.r_[0.0, np.cumsum(dt)] - dt[0]
    total = np.maximum(edges + 0.05 * np.expm1(-np.maximum(edges, 0.0) / 0.05), 0.0)  # integral of 1 - exp(-t / T)
    np.testing.assert_allclose(once(effect, step, dt, 0.05), np.diff(total) / dt, atol=1e-12)
    np.testing.assert_allclose(once(effect, np.ones(100), dt, 0.05), 1.0)  # held before the run


@pytest.mark.parametrize("delay", [0.0117, 0.0124, 0.013])
@pytest.mark.parametrize(("integrator", "step"), [("RK4", 0.0025), ("RK4", 0.005), ("Euler", 0.0025)])
def test_the_file_delays_a_held_control_as_long_as_the_law(integrator: str, step: float, delay: float) -> None:
    """Against the law in steps of 0.05 ms, by how much later a mass moves: within an eighth of a time step.

    Euler's steps put a control half of one early, with a delay or without.
    """
    text = """<mujoco><option timestep="{}" integrator="{}" gravity="0 0 0"/><worldbody><body>
    <joint name="x" type="slide"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body></worldbody>
    <actuator><motor name="drive" joint="x"/></actuator></mujoco>"""
    spec = mujoco.MjSpec.from_string(text.format(step, integrator))
    place = Place("actuator:drive", 0)
    assert ActuatorDelay.at(place, spec.compile()).write(spec, np.array([delay]))

    def positions(model: mujoco.MjModel, steps: int, control: np.ndarray) -> np.ndarray:
        data, out = mujoco.MjData(model), []
        for row in control:
            out.append(data.qpos[0])
            for u in np.broadcast_to(row, steps):
                data.ctrl[:] = u
                mujoco.mj_step(model, data)
        return np.array(out)

    row, fine = 0.01, 200
    held = np.concatenate([np.zeros(4), np.random.default_rng(0).normal(size=200)])
    when = (np.arange(len(held) * fine) + 0.5) * row / fine - delay
    late = held[np.maximum(np.floor(when / row).astype(int), 0)].reshape(-1, fine)
    exact = positions(mujoco.MjModel.from_xml_string(text.format(row / fine, "RK4")), fine, late)
    found = positions(spec.compile(), round(row / step), held)
    later = -np.linalg.lstsq(np.gradient(exact, row)[:, None], found - exact, rcond=None)[0][0]
    assert later == pytest.approx(-0.5 * step * (integrator == "Euler"), abs=step / 8)


def test_a_delay_shifts_and_keeps_the_impulse(bench: Any) -> None:
    effect, dt = ActuatorDelay.at(bench.drive, bench.model), np.full(200, 0.01)
    u = np.where(np.arange(200) < 100, np.sin(np.arange(200)), 0.0)
    np.testing.assert_allclose(once(effect, u, dt, 0.03)[3:], u[:-3], atol=1e-12)
    np.testing.assert_allclose(once(effect, u, dt, 0.035)[4:], 0.5 * (u[1:-3] + u[:-4]), atol=1e-12)
    assert once(effect, u, dt, 0.0237).sum() == pytest.approx(u.sum())
    np.testing.assert_allclose(once(effect, np.full(200, 0.7), dt, 0.1), 0.7)
    uneven = np.where(np.arange(200) % 3, 0.01, 0.013)
    assert (once(effect, u, uneven, 0.05) * uneven).sum() == pytest.approx((u * uneven).sum())


def test_only_their_own_control_changes_and_each_case_has_its_value(bench: Any) -> None:
    control, dt = np.random.default_rng(0).normal(size=(2, 3, 20, 2)), np.full((3, 20), 0.01)
    for kind in ACTUATION:
        effect, changed = kind.at(bench.servo, bench.model), control.copy()
        values = np.array([[0.05], [0.1]])
        effect.control(changed, dt, values)
        np.testing.assert_array_equal(changed[..., 0], control[..., 0])
        for case in range(2):
            alone = control[case : case + 1].copy()
            effect.control(alone, dt, values[case : case + 1])
            np.testing.assert_array_equal(alone[0], changed[case])


def test_the_gain_is_described_against_one(bench: Any) -> None:
    assert ActuatorGain.at(bench.drive, bench.model).describe(np.array([-0.2])) == {"gain": 0.8}
