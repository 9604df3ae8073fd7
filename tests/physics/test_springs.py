from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics.cogging import Cogging
from torch_activegp.physics.springs import (
    POSITION_FORCES,
    CenteredSpring,
    ConstantForce,
    CubicSpring,
    LinearSpring,
    Spring,
)
from torch_activegp.physics.stops import JointStop, LowerJointStop

CASES = [
    (ConstantForce, [0.4], 1e-3),
    (CenteredSpring, [0.8], 1e-3),
    (LinearSpring, [0.8, 0.3], 1e-3),
    (CubicSpring, [1.5], 1e-3),
    (Cogging, [0.3, 0.2, 7.0], 1e-3),
    (JointStop, [60.0, 0.5, 0.1], 0.02),
    (LowerJointStop, [60.0, 0.5, 0.02], 0.02),
]
NAMED = [(kind, values) for kind, values, _ in CASES]


def test_the_cases_are_the_family() -> None:
    assert {case[0] for case in CASES} == set(POSITION_FORCES)


@pytest.mark.parametrize(("kind", "values"), NAMED, ids=lambda x: getattr(x, "__name__", ""))
def test_the_law_as_a_force_does_the_same(bench: Any, kind: Any, values: Any) -> None:
    effect = kind.at(bench.shoulder, bench.model)
    assert bench.gap(bench.hooks(effect, values), bench.force(effect, values)) < 1e-12


@pytest.mark.parametrize(("kind", "values"), NAMED, ids=lambda x: getattr(x, "__name__", ""))
def test_and_on_another_joint_whose_own_spring_rests_elsewhere(bench: Any, kind: Any, values: Any) -> None:
    xml = bench.xml.replace('name="elbow"', 'name="elbow" stiffness="0.2" springref="0.4"')
    assert xml != bench.xml
    machine = dataclasses.replace(bench, xml=xml)
    effect = kind.at(machine.elbow, machine.model)
    assert machine.gap(machine.hooks(effect, values), machine.force(effect, values)) < 1e-12


@pytest.mark.parametrize(("kind", "values", "near"), CASES, ids=lambda x: getattr(x, "__name__", ""))
@pytest.mark.parametrize("degree", [False, True])
def test_the_models_file_does_the_same(bench: Any, kind: Any, values: Any, near: float, degree: bool) -> None:
    machine = dataclasses.replace(bench, xml=bench.xml.replace('angle="radian"', "")) if degree else bench
    effect = kind.at(machine.shoulder, machine.model)
    assert machine.gap(machine.hooks(effect, values), machine.written(effect, values)) < near


@pytest.mark.parametrize(("kind", "values"), [case for case in NAMED if issubclass(case[0], Spring)])
def test_the_force_pulls_back(bench: Any, kind: Any, values: Any) -> None:
    effect = kind.at(bench.shoulder, bench.model)
    position = np.linspace(-1.5, 1.5, 301)
    force = effect.force(position, 0.0 * position, values)
    assert (np.diff(force) <= 0.0).all()


def test_a_spring_adds_to_the_models_own(bench: Any) -> None:
    xml = bench.xml.replace('damping="0.05"', 'damping="0.05" stiffness="0.5" springref="0.3"')
    machine = dataclasses.replace(bench, xml=xml)
    for kind, values in ((CenteredSpring, [0.8]), (LinearSpring, [0.8, 0.3]), (LinearSpring, [-0.2, 0.1])):
        effect = kind.at(machine.shoulder, machine.model)
        assert effect.parameters[0].low == -0.5
        assert machine.gap(machine.hooks(effect, values), machine.written(effect, values)) < 1e-3
    assert not LinearSpring.at(machine.shoulder, machine.model).write(machine.spec, np.array([-0.5, 0.1]))
    assert not CubicSpring.at(machine.shoulder, machine.model).write(machine.spec, np.array([1.0]))


@pytest.mark.parametrize("stiffness", [0.0, 0.5])
def test_a_spring_is_tuned_where_the_model_has_one(bench: Any, stiffness: float) -> None:
    xml = bench.xml.replace('damping="0.05"', f'damping="0.05" stiffness="{stiffness}"')
    model = mujoco.MjModel.from_xml_string(xml)
    for kind, tuned in ((CenteredSpring, stiffness > 0.0), (LinearSpring, stiffness > 0.0), (CubicSpring, False)):
        assert kind.at(bench.shoulder, model).tunable is tuned
        assert not kind.at(bench.elbow, model).tunable


def test_a_rest_position_and_a_cubic_spring_do_not_fit_in_one_file(bench: Any) -> None:
    spec = bench.spec
    assert CubicSpring.at(bench.shoulder, bench.model).write(spec, np.array([1.0]))
    assert not LinearSpring.at(bench.shoulder, bench.model).write(spec, np.array([0.8, 0.3]))


def test_descriptions_speak_the_fields_words(bench: Any) -> None:
    model = bench.model
    rest = LinearSpring.at(bench.shoulder, model).describe(np.array([2.0, 1.0]))
    assert rest == {"stiffness": 2.0, "rest": 0.5}
