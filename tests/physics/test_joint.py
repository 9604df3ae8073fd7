from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import mujoco
import numpy as np
import pytest

from torch_activegp.physics import Parameter, Place, Step
from torch_activegp.physics.inertia import ArmatureError
from torch_activegp.physics.joint import JointEffect, driven, drivers
from torch_activegp.physics.springs import ConstantForce


class Wind(JointEffect):
    name = "wind"
    law = "F (1 + q v)"

    @classmethod
    def at(cls, place: Place, model: mujoco.MjModel) -> Self:
        return cls.make(place, (Parameter("force", place.force_unit, 0.1),), [[0.1]], variant="warm")

    def force(
        self, position: np.ndarray, velocity: np.ndarray, values: Sequence[np.ndarray] | np.ndarray
    ) -> np.ndarray:
        return np.asarray(values[0] * (1.0 + position * velocity))


def test_a_law_acts_on_its_own_joint_in_its_own_simulations(bench: Any) -> None:
    effect = Wind.at(bench.elbow, bench.model)
    assert (effect.dof, effect.qpos, effect.variant, effect.seeds.shape) == (1, 1, "warm", (1, 1))
    rng = np.random.default_rng(0)
    q, v, force = rng.normal(size=(4, 2)), rng.normal(size=(4, 2)), np.ones((4, 2))
    step = Step(q, v, np.zeros((4, 0)), force, lambda name: q, np.ones(4))
    effect.before_step(step, np.array([1, 3]), np.array([[2.0], [3.0]]), None)
    wanted = np.ones((4, 2))
    wanted[[1, 3], 1] += np.array([2.0, 3.0]) * (1.0 + q[[1, 3], 1] * v[[1, 3], 1])
    np.testing.assert_allclose(force, wanted)


def test_a_law_is_all_that_an_effect_needs(bench: Any) -> None:
    effect = Wind.at(bench.elbow, bench.model)
    assert bench.gap(bench.hooks(effect, [0.2]), bench.force(effect, [0.2])) < 1e-12
    with pytest.raises(NotImplementedError):
        JointEffect("joint:elbow", (), np.zeros((1, 0))).force(np.zeros(1), np.zeros(1), [])


def test_passive_actuators_get_names_of_their_own_and_no_control(bench: Any) -> None:
    unnamed = bench.xml.replace('name="shoulder"', "").replace('<motor name="drive" joint="shoulder" gear="2"/>', "")
    spec = mujoco.MjSpec.from_string(unnamed)
    effect = Wind.at(Place("joint:joint0", 0), spec.copy().compile())
    effect.add_passive(spec, cogging=[0.3, 5.0, 0.1])
    effect.add_passive(spec, cogging=[0.1, 7.0, 0.2])
    model = spec.compile()
    assert [model.actuator(i).name for i in range(3)] == ["servo", "joint0_wind", "joint0_wind_0"]
    assert model.nu == 1
    data = mujoco.MjData(model)
    data.qpos[0] = 0.4
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(0.3 * np.sin(2.1) + 0.1 * np.sin(3.0))


def test_positions_are_written_in_the_files_unit(bench: Any) -> None:
    effect, degrees = (
        Wind.at(bench.elbow, bench.model),
        mujoco.MjSpec.from_string(bench.xml.replace('angle="radian"', "")),
    )
    assert effect.angle(bench.spec, np.pi) == np.pi
    assert effect.angle(degrees, np.pi) == pytest.approx(180.0)
    slide = mujoco.MjSpec.from_string(
        bench.xml.replace('name="elbow" axis', 'name="elbow" type="slide" axis').replace('angle="radian"', "")
    )
    assert effect.angle(slide, np.pi) == np.pi


_TWO = """<mujoco><worldbody><body><joint name="a" axis="0 1 0"/><geom size="0.1"/>
<body pos="0 0 1"><joint name="b" axis="0 1 0"/><geom size="0.1"/></body></body></worldbody>
<tendon><fixed name="cable"><joint joint="a" coef="1"/><joint joint="b" coef="1"/></fixed></tendon>
<actuator><{on}/></actuator></mujoco>"""
_LOSS = 'dcmotor joint="b" motorconst="0 0" resistance="1" input="none" cogging="0.1 6 0"'


@pytest.mark.parametrize(
    ("on", "second"),
    [
        ('motor joint="a"', False),
        ('motor joint="b"', True),
        ('motor jointinparent="a"', False),
        ('motor jointinparent="b"', True),
        ('motor tendon="cable"', True),
        (_LOSS, False),
    ],
)
def test_rotor_and_offset_are_tuned_where_a_drive_is(on: str, second: bool) -> None:
    model = mujoco.MjModel.from_xml_string(_TWO.format(on=on))
    place = Place("joint:b", 1)
    assert driven(place, model) is second
    assert list(drivers(place, model)) == ([0] if second and "tendon" not in on else [])
    for kind in (ArmatureError, ConstantForce):
        assert kind.at(place, model).tunable is second
