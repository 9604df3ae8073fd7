from __future__ import annotations

import mujoco
import pytest

from torch_activegp.diagnosis.inputs.control_limits import clipped_controls

XML = """
<mujoco><option><flag clampctrl="{}"/></option><worldbody><body><joint name="slide" type="slide"/><geom size=".1"/>
</body></worldbody><actuator><motor joint="slide" ctrlrange="-1 1"/><motor joint="slide"/></actuator></mujoco>"""


@pytest.mark.parametrize(("flag", "clipped"), [("enable", [True, False]), ("disable", [False, False])])
def test_controls_are_clipped_where_mujoco_does_so(flag: str, clipped: list[bool]) -> None:
    model = mujoco.MjModel.from_xml_string(XML.format(flag))
    data = mujoco.MjData(model)
    data.ctrl[:] = 5.0
    mujoco.mj_forward(model, data)
    assert clipped_controls(model).tolist() == (data.actuator_force < 5.0).tolist() == clipped
