from __future__ import annotations

from typing import Any

import mujoco
import mujoco.batch
import numpy as np
import pytest

from torch_activegp.physics import Place
from torch_activegp.physics.inertia import CenterOfMassOffset
from torch_activegp.physics.payload import PayloadMass

BALANCED = """
<mujoco><option timestep="0.001"/><worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0"/>
<joint name="turn" axis="0 1 0"/><geom type="box" size=".2 .05 .1" mass="1"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("joints", ["one", "two"])
def test_a_balanced_body_can_lose_its_balance(joints: str) -> None:
    """Such bodies are compiled to a short cut, and a batch refuses to run on it once they are not balanced."""
    xml = BALANCED if joints == "two" else BALANCED.replace('<joint name="x" type="slide" axis="1 0 0"/>', "")
    spec = mujoco.MjSpec.from_string(xml)
    spec.body("cart").simple = joints == "one"
    model = spec.compile()
    effect = CenterOfMassOffset.along(Place("body:cart", 1), 0.2, 0)
    batch = mujoco.batch.Batch(model, 2, 1)
    effect.edit(batch.expand, np.array([1]), np.array([[0.1]]))
    batch.set_const(np.arange(2, dtype=np.int32))
    batch.step(None, 200)
    assert effect.write(spec, np.array([0.1]))
    data = mujoco.MjData(spec.compile())
    for _ in range(200):
        mujoco.mj_step(data.model, data)
    np.testing.assert_allclose(batch.bind("qpos")[1], data.qpos, rtol=1e-9)
    np.testing.assert_array_equal(batch.bind("qpos")[0], 0.0)
    assert (np.abs(data.qpos) > 1e-3).all()


@pytest.mark.parametrize("option", ["inertiafromgeom", "settotalmass", "fusestatic"])
def test_a_file_that_computes_its_own_inertia_cannot_hold_one(bench: Any, option: str) -> None:
    spec = bench.spec
    setattr(spec.compiler, option, 2.0 if option == "settotalmass" else 1)
    assert not PayloadMass.at(Place("body:fore", 2), bench.model).write(spec, np.array([0.3]))
    assert not spec.body("fore").explicitinertial
