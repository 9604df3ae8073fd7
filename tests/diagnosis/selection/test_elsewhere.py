from __future__ import annotations

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from torch_activegp.diagnosis.selection.elsewhere import elsewhere, late_elsewhere, pushed_elsewhere


@pytest.mark.parametrize(
    ("late", "other"),
    [
        ("actuator_delay", "sensor_delay"),
        ("sensor_delay", "actuator_delay"),
        ("actuator_delay", "actuator_lag"),
        ("actuator_lag", "actuator_delay"),
    ],
)
def test_a_late_drive_may_be_a_late_encoder_or_late_in_another_way(bench, late, other) -> None:
    places = {"actuator_delay": "actuator:drive", "actuator_lag": "actuator:drive", "sensor_delay": "sensor:hip"}
    effect, rubbing = bench.effect(late, places[late]), bench.effect("viscous_friction")
    fit = SimpleNamespace(effects=(rubbing, effect), values=(np.array([0.1]), np.array([0.004])))
    found = {effects[1].name: (effects, values) for effects, values in late_elsewhere(fit, bench.effects)}
    effects, values = found[other]
    assert (effects[0], effects[1].target) == (rubbing, places[other])
    assert [float(value[0]) for value in values] == [0.1, 0.004]
    assert late not in found
    alone = SimpleNamespace(effects=(rubbing,), values=(np.array([0.1]),))
    assert late_elsewhere(alone, bench.effects) == []


def test_two_that_are_late_are_one_that_is_as_late_as_both(bench) -> None:
    delay, lag = (bench.effect(name, "actuator:drive") for name in ("actuator_delay", "actuator_lag"))
    late, rubbing = bench.effect("sensor_delay", "sensor:hip"), bench.effect("viscous_friction")
    fit = SimpleNamespace(effects=(lag, rubbing, late), values=tuple(np.array([v]) for v in (0.006, 0.1, 0.001)))
    sums = {some[0][1]: float(some[1][1][0]) for some in late_elsewhere(fit, bench.effects) if len(some[0]) == 2}
    assert sums == {effect: pytest.approx(0.007) for effect in (delay, lag, late)}
    three = SimpleNamespace(effects=(delay, lag, late), values=tuple(np.array([v]) for v in (0.002, 0.006, 0.001)))
    sets = [effects for effects, _ in late_elsewhere(three, bench.effects)]
    assert {len(set(effects)) for effects in sets} == {1, 2}
    assert all(len(set(effects)) == len(effects) for effects in sets)


def test_two_drives_of_one_joint_are_not_late_for_each_other(bench) -> None:
    delay, lag = (bench.effect(name, "actuator:drive") for name in ("actuator_delay", "actuator_lag"))
    other = dataclasses.replace(lag, target="actuator:other")
    assert other.drives == delay.drives
    fit = SimpleNamespace(effects=(delay,), values=(np.array([0.004]),))
    assert [effects for effects, _ in late_elsewhere(fit, [lag, other])] == [(lag,)]


def _set(*pairs):
    effects, values = zip(*((effect, np.array([value])) for effect, value in pairs), strict=True)
    return SimpleNamespace(effects=effects, values=values, keys={effect.key for effect in effects})


def test_a_constant_force_is_a_drives_bias_and_the_other_way_round(bench) -> None:
    rubbing, force = bench.effect("viscous_friction"), bench.effect("constant_force")
    bias = bench.effect("actuator_bias", "actuator:drive")
    geared = dataclasses.replace(bias, gear=4.0)
    pushes = [force, geared, rubbing]
    ((effects, values),) = pushed_elsewhere(_set((rubbing, 0.1), (force, 0.2)), pushes)
    assert effects == (rubbing, geared)
    np.testing.assert_allclose(np.concatenate(values), [0.1, 0.2 / (4.0 * bias.nominal_gain)])
    ((effects, values),) = elsewhere(_set((geared, 0.05)), pushes)
    assert effects == (force,)
    assert values[0][0] == pytest.approx(0.2 * bias.nominal_gain)
    assert pushed_elsewhere(_set((rubbing, 0.1)), pushes) == []
    assert pushed_elsewhere(_set((force, 0.1), (geared, 0.1)), pushes) == []


def test_gravity_pulls_at_a_slide_as_a_constant_force_does(bench) -> None:
    gravity, force = bench.effect("gravity_error", "world"), bench.effect("constant_force")
    pulling = dataclasses.replace(gravity, axes=(2,), pulls={force.target: np.array([0.0, 0.0, 3.0])})
    ((effects, values),) = pushed_elsewhere(_set((pulling, -0.5)), [force])
    assert (effects, values[0][0]) == ((force,), pytest.approx(-1.5))
    assert pushed_elsewhere(_set((gravity, -0.5)), [force]) == []
