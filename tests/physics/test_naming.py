from __future__ import annotations

import mujoco
import numpy as np

from torch_activegp.physics.naming import actuator_name, joint_name

XML = """<mujoco><worldbody><body><joint name="hip"/><geom size="0.1"/><body><joint/><geom size="0.1"/></body></body>
</worldbody><actuator><motor joint="hip"/><motor name="drive" joint="hip"/></actuator></mujoco>"""


def test_elements_without_a_name_go_by_their_kind_and_number() -> None:
    model = mujoco.MjModel.from_xml_string(XML)
    assert [joint_name(model, i) for i in np.arange(2)] == ["hip", "joint1"]
    assert [actuator_name(model, i) for i in np.arange(2)] == ["actuator0", "drive"]
