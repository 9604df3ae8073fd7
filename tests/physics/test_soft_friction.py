from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest

from torch_activegp.physics.friction import CoulombFriction, write_sharp
from torch_activegp.physics.soft_friction import SoftCoulombFriction

STUCK = """
<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody><body name="b"><joint name="j" axis="0 1 0"/>
<geom size=".1" mass="1"/></body></worldbody><actuator><motor name="m" joint="j"/></actuator></mujoco>"""


def test_it_is_what_mujoco_does_with_frictionloss_alone(bench: Any) -> None:
    effect = SoftCoulombFriction.at(bench.shoulder, bench.model)
    plain = dataclasses.replace(
        bench, xml=bench.xml.replace('<joint name="shoulder"', '<joint name="shoulder" frictionloss="0.4"')
    )
    assert plain.model.dof_frictionloss[0] == 0.4
    states = bench.hooks(effect, [0.4])
    assert bench.gap(states, plain.nominal()) < 1e-9
    assert bench.gap(states, bench.written(effect, [0.4])) < 1e-9


def test_it_creeps_where_firm_friction_sticks(bench: Any) -> None:
    machine = dataclasses.replace(bench, xml=STUCK, start=(0.0,), control=np.full((500, 1), 0.3))
    place = dataclasses.replace(machine.shoulder, target="joint:j")
    soft, firm = (
        abs(machine.hooks(kind.at(place, machine.model), [0.4])[-1, 0])
        for kind in (SoftCoulombFriction, CoulombFriction)
    )
    assert firm < 2e-3 < soft


def test_it_is_another_form_of_one_name(bench: Any) -> None:
    soft, firm = (kind.at(bench.shoulder, bench.model) for kind in (SoftCoulombFriction, CoulombFriction))
    assert soft.key == firm.key
    assert soft.variant != firm.variant
    assert soft.stands_in
    assert not firm.stands_in
    assert soft.parameters == firm.parameters


def test_what_the_file_says_of_softness_stays(bench: Any) -> None:
    spec = mujoco.MjSpec.from_string(bench.xml)
    spec.joint("shoulder").solref_friction = np.array([0.05, 1.0])
    effect = SoftCoulombFriction.at(bench.shoulder, spec.compile())
    write_sharp(spec.joint("shoulder"), 0.001)
    assert effect.write(spec, np.array([0.4]))
    model = spec.compile()
    assert model.dof_frictionloss[0] == pytest.approx(0.4)
    assert model.dof_solref[0, 0] == 0.05
    assert model.dof_solimp[0, 0] == bench.model.dof_solimp[0, 0]


def test_it_is_soft_where_the_model_was_made_firm(bench: Any) -> None:
    soft = dataclasses.replace(bench, xml=bench.xml.replace('name="shoulder"', 'name="shoulder" frictionloss="0.1"', 1))
    effect = SoftCoulombFriction.at(soft.shoulder, soft.model)
    spec = mujoco.MjSpec.from_string(soft.xml)
    write_sharp(spec.joint("shoulder"), 0.001)
    firm = dataclasses.replace(soft, xml=spec.to_xml())
    assert bench.gap(firm.hooks(effect, [0.3]), soft.hooks(effect, [0.3])) < 1e-9
