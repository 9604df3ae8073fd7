from __future__ import annotations

import mujoco
import mujoco.batch
import numpy as np

from torch_activegp.diagnosis.simulation.fields import Fields

XML = """<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><joint name="y" axis="0 1 0"/>
<geom type="box" size=".1 .1 .1" mass="2"/></body></worldbody></mujoco>"""


def test_constants_follow_an_edit_until_it_is_put_back() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    fields = Fields(mujoco.batch.Batch(model, 3, 1))
    own = model.body_subtreemass[0]
    fields("body_mass")[1, 1] = 5.0
    fields.derive(np.array([False, True, False]))
    np.testing.assert_allclose(fields("body_subtreemass")[:, 0], [own, own + 3.0, own])
    fields.restore(model)
    np.testing.assert_allclose(fields("body_mass")[:, 1], 2.0)
    fields.derive(np.zeros(3, dtype=bool))  # what was edited before follows too
    np.testing.assert_allclose(fields("body_subtreemass")[:, 0], own)


def test_a_field_of_the_options_goes_by_its_name() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    fields = Fields(mujoco.batch.Batch(model, 2, 1))
    fields("opt.timestep")[0] = 0.5
    fields.restore(model)
    np.testing.assert_allclose(fields("opt.timestep"), model.opt.timestep)
