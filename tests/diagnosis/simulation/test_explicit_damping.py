from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.simulation.explicit_damping import explicit, is_explicit, make_explicit

XML = """
<mujoco><option timestep="0.002" integrator="implicitfast" gravity="0 0 0"/><worldbody><body>
<joint name="x" type="slide" axis="1 0 0" damping="3"/><geom size=".1" mass="0.5"/></body></worldbody>
<actuator><position joint="x" kp="40" kv="2"/></actuator></mujoco>"""


def test_it_is_the_scheme_of_most_simulators() -> None:
    """v += h a(q, v), q += h v, with all damping at the speed that the step begins with."""
    model = mujoco.MjModel.from_xml_string(XML)
    data = {made: mujoco.MjData(made) for made in (model, explicit(model))}
    h, q, v = 0.002, 0.0, 0.0
    for step in range(200):
        u = 0.1 * (step < 100)
        for made, state in data.items():
            state.ctrl[:] = u
            mujoco.mj_step(made, state)
        v += h * (40 * (u - q) - 5 * v) / 0.5
        q += h * v
    plain, other = (state.qpos[0] for state in data.values())
    assert other == pytest.approx(q, rel=1e-9)
    assert abs(plain - q) > 1e-4


def test_a_model_is_copied_and_one_that_is_edited_changes() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    assert (is_explicit(model), is_explicit(explicit(model))) == (False, True)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    assert not is_explicit(model)  # MuJoCo's own is implicit in the damping
    implicit = explicit(model)
    implicit.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
    assert not is_explicit(implicit)
    spec = mujoco.MjSpec.from_string(XML)
    make_explicit(spec.option)
    assert is_explicit(spec.compile())
    np.testing.assert_array_equal(explicit(model).dof_damping, model.dof_damping)
