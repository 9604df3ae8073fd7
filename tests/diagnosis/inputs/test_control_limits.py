from __future__ import annotations

import mujoco
import numpy as np
import pytest

from torch_activegp.diagnosis.inputs.control_limits import control_limits

XML = """
<mujoco><option><flag clampctrl="{}"/></option><worldbody><body><joint name="slide" type="slide"/><geom size=".1"/>
</body></worldbody><actuator><motor joint="slide" ctrlrange="-1 1"/><motor joint="slide"/></actuator></mujoco>"""


@pytest.mark.parametrize(("flag", "clipped"), [("enable", [True, False]), ("disable", [False, False])])
def test_controls_are_clipped_where_mujoco_does_so(flag: str, clipped: list[bool]) -> None:
    model = mujoco.MjModel.from_xml_string(XML.format(flag))
    data = mujoco.MjData(model)
    data.ctrl[:] = 5.0
    mujoco.mj_forward(model, data)
    _, high = control_limits(model)
    np.testing.assert_array_equal(np.minimum(5.0, high), data.actuator_force)
    assert np.isfinite(control_limits(model)).all(axis=0).tolist() == clipped
