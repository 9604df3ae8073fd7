from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from torch_activegp.diagnosis.selection import sensitivities
from torch_activegp.diagnosis.selection.sensitivities import effect_columns, parameter_columns, remembered, unit_values
from torch_activegp.diagnosis.shooting.linearize import linearize
from torch_activegp.diagnosis.simulation.candidate import Candidate
from torch_activegp.physics.effect import Parameter
from torch_activegp.physics.sensing import SensorEffect
from torch_activegp.physics.servo import ServoSaturation


@pytest.mark.parametrize(
    ("name", "target", "size"),
    [
        ("viscous_friction", "joint:hip", 1e-3),
        ("armature_error", "joint:hip", 1e-3),
        ("actuator_gain", "actuator:drive", 1e-3),
        ("actuator_lag", "actuator:drive", 2e-3),
        ("sensor_gain", "sensor:hip", 1e-3),
        ("payload_mass", "body:rod", 1e-3),
        ("center_of_mass_offset", "body:rod", 1e-3),
        ("gravity_error", "world", 1e-2),
    ],
)
def test_columns_are_what_a_simulation_changes_by(clean, name, target, size) -> None:
    effect, values = clean.effect(name, target), np.array([size])
    linear = linearize(clean.shooting, clean.nominal)
    wanted = [(effect, values)]
    column = effect_columns(clean.shooting, clean.nominal, wanted, linear, remembered(wanted, clean.shooting))
    simulated = clean.predict(Candidate((effect,), (values,))) - clean.predict(clean.nominal.candidate)
    assert np.abs(column[..., 0] - simulated).max() < 0.06 * np.abs(simulated).max()


@pytest.mark.parametrize("own", ["", "-6 6"])
def test_a_limit_of_a_servos_force_is_what_a_simulation_changes_by(servo, own: str) -> None:
    """Near its largest force, or its own limit, where what it loses changes the motion little."""
    xml = servo.xml.replace('kv="1"', f'kv="1" forcerange="{own}"' if own else 'kv="1"')
    bench = dataclasses.replace(servo, xml=xml).bench(np.inf)
    limit = next(effect for effect in bench.effects if isinstance(effect, ServoSaturation))
    assert limit.parameters[0].unit == "N m"
    if own:
        assert limit.parameters[0].high == pytest.approx(6.0)
    values = np.array([0.9 * limit.parameters[0].high])
    linear = linearize(bench.shooting, bench.nominal)
    wanted = [(limit, values)]
    column = effect_columns(bench.shooting, bench.nominal, wanted, linear, remembered(wanted, bench.shooting))
    simulated = bench.predict(Candidate((limit,), (values,))) - bench.predict(bench.nominal.candidate)
    assert np.abs(simulated).max() > 10 * bench.noise
    assert np.abs(column[..., 0] - simulated).max() < 0.2 * np.abs(simulated).max()


class SensorCurve(SensorEffect):
    """q + b q^2: a user's own."""

    name = "sensor_curve"

    def measure(self, read, values):
        position = read(self.channel, np.zeros(len(values)))
        return self.channel, position + values[:, :1] * position**2


@pytest.mark.parametrize("size", [1e-3, 0.1])
def test_a_sensor_of_a_users_own_is_tested_like_the_others(clean, size: float) -> None:
    effect = SensorCurve("sensor:hip", (Parameter("curve", "1/rad", 0.1),), np.array([[0.1]]))
    wanted = [(effect, np.array([size]))]
    linear = linearize(clean.shooting, clean.nominal)
    column = effect_columns(clean.shooting, clean.nominal, wanted, linear, remembered(wanted, clean.shooting))
    np.testing.assert_allclose(column[..., 0], size * clean.predict(clean.nominal.candidate) ** 2, atol=1e-9)


def test_changes_of_inertia_want_no_simulation(clean, monkeypatch) -> None:
    wanted = [(clean.effect("payload_mass", "body:rod"), np.array([1e-3]))]
    linear = linearize(clean.shooting, clean.nominal)
    work = clean.shooting.work
    column = effect_columns(clean.shooting, clean.nominal, wanted, linear, {})
    assert clean.shooting.work == work
    monkeypatch.setattr(sensitivities, "_all_seen", lambda shooting: False)
    simulated = effect_columns(clean.shooting, clean.nominal, wanted, linear, {})
    assert clean.shooting.work > work
    assert np.abs(column - simulated).max() < 0.03 * np.abs(simulated).max()
    monkeypatch.undo()
    blind = dataclasses.replace(clean.shooting.engine.channels, dof=np.zeros(0, dtype=np.int64))
    monkeypatch.setattr(clean.shooting.engine, "channels", blind)
    assert not sensitivities._all_seen(clean.shooting)


@pytest.mark.parametrize(("name", "target"), [("center_of_mass_offset", "body:rod"), ("gravity_error", "world")])
def test_changes_of_inertia_come_on_top_of_what_is_fitted(clean, monkeypatch, name, target) -> None:
    """A load that is known already is shifted and falls too."""
    load = clean.effect("payload_mass", "body:rod")
    held = Candidate((load,), (np.array([1.5]),))
    fit = dataclasses.replace(clean.nominal, effects=held.effects, values=held.values)
    wanted = [(clean.effect(name, target), np.array([1e-3]))]
    linear = linearize(clean.shooting, fit)
    column = effect_columns(clean.shooting, fit, wanted, linear, {})
    monkeypatch.setattr(sensitivities, "_all_seen", lambda shooting: False)
    simulated = effect_columns(clean.shooting, fit, wanted, linear, {})
    assert np.abs(column - simulated).max() < 0.1 * np.abs(simulated).max()


def test_what_controls_become_is_the_same_one_by_one(clean) -> None:
    effects = [clean.effect("actuator_lag", "actuator:drive"), clean.effect("actuator_delay", "actuator:drive")]
    wanted = [(effect, seed) for effect in effects for seed in effect.seeds[:3]]
    together = remembered(wanted, clean.shooting)
    assert list(together) == [*range(6)]
    for number, one in enumerate(wanted):
        np.testing.assert_allclose(together[number], remembered([one], clean.shooting)[0], atol=1e-12)


def test_a_machine_without_controls_remembers_nothing(clean) -> None:
    runs = tuple(dataclasses.replace(run, control=run.control[:, :0]) for run in clean.segments.runs)
    segments = dataclasses.replace(clean.segments, runs=runs)
    assert remembered([], dataclasses.replace(clean.shooting, segments=segments)) == {}


def test_only_effects_on_actuators_change_controls(clean) -> None:
    effects = clean.effect("viscous_friction"), clean.effect("actuator_bias", "actuator:drive")
    wanted = [(effect, np.ones(1)) for effect in effects]
    memory = remembered(wanted, clean.shooting)
    assert list(memory) == [1]
    np.testing.assert_allclose(memory[1], 1.0)


def test_parameters_of_a_fit_have_columns_too(bench) -> None:
    fit = bench.fit("viscous_friction", 0.05)
    column = parameter_columns(bench.shooting, fit)
    step = 0.05 * np.maximum(np.abs(fit.values[0]), fit.effects[0].parameters[0].scale)
    more = dataclasses.replace(fit, values=(fit.values[0] + step,))
    moved = bench.predict(more.candidate, fit.starts) - bench.predict(fit.candidate, fit.starts)
    np.testing.assert_allclose(column[..., 0], moved, rtol=1e-6, atol=1e-12)


def test_every_amplitude_is_tried_alone(bench) -> None:
    effect = bench.effect("cogging")
    first, second = unit_values(effect, effect.seeds[0])
    assert first[1] == second[0] == 0.0
    assert first[0] == second[1] != 0.0
