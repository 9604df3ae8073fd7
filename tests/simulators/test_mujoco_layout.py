from __future__ import annotations

import math

import mujoco
import numpy as np
import pytest

from torch_activegp.errors import ConfigurationError
from torch_activegp.simulators.mujoco_layout import action_space, state_space

MIXED = mujoco.MjModel.from_xml_string("""
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body><freejoint name="base"/><geom size=".1"/>
      <body pos="1 0 0"><joint name="wrist" type="ball"/><geom size=".1"/></body>
      <body pos="0 1 0"><joint name="lift" type="slide" range="-.5 .5" limited="true"/><geom size=".1"/></body>
      <body pos="0 2 0"><joint name="wheel" type="hinge"/><geom size=".1"/></body>
      <body pos="0 3 0"><joint type="hinge" range="-4 4" limited="true"/><geom size=".1"/></body>
    </body>
  </worldbody>
  <actuator>
    <general name="muscle" joint="lift" dyntype="filter" dynprm="1" actlimited="true" actrange="0 1"/>
    <motor joint="wheel" ctrllimited="true" ctrlrange="-2 3"/>
    <intvelocity name="servo" joint="lift" kp="1" actrange="-1 1"/>
  </actuator>
</mujoco>""")


def test_names_follow_the_order_of_qpos_qvel_and_act() -> None:
    space = state_space(MIXED)
    assert space.dim == MIXED.nq + MIXED.nv + MIXED.na
    base = [f"qpos.base.{suffix}" for suffix in ("x", "y", "z", "qw", "qx", "qy", "qz")]
    assert space.names[:7] == tuple(base)
    assert space.names[7:14] == (
        *(f"qpos.wrist.{suffix}" for suffix in ("qw", "qx", "qy", "qz")),
        *("qpos.lift", "qpos.wheel", "qpos.joint4"),
    )
    velocities = [f"qvel.base.{suffix}" for suffix in ("vx", "vy", "vz", "wx", "wy", "wz")]
    assert space.names[14:20] == tuple(velocities)
    assert space.names[20:26] == (
        *("qvel.wrist.wx", "qvel.wrist.wy", "qvel.wrist.wz"),
        *("qvel.lift", "qvel.wheel", "qvel.joint4"),
    )
    assert space.names[26:] == ("act.muscle", "act.servo")


def test_angles_quaternions_and_bounds_come_from_the_model() -> None:
    space = state_space(MIXED)
    assert [space.names[index] for index in space.angles] == ["qpos.wheel"]
    assert [space.names[index] for index in space.quaternions] == ["qpos.base.qw", "qpos.wrist.qw"]
    bounds = {
        name: (low, high) for name, low, high in zip(space.names, space.low.tolist(), space.high.tolist(), strict=True)
    }
    assert bounds["qpos.wheel"] == (-math.pi, math.pi)
    assert bounds["qpos.lift"] == (-0.5, 0.5)
    assert bounds["qpos.joint4"] == (-4.0, 4.0)
    assert bounds["qpos.wrist.qx"] == (-1.0, 1.0)
    assert bounds["act.muscle"] == (0.0, 1.0)
    assert bounds["act.servo"] == (-1.0, 1.0)
    unbounded = {name for name, limit in bounds.items() if limit == (-math.inf, math.inf)}
    assert unbounded == {"qpos.base.x", "qpos.base.y", "qpos.base.z", *space.names[14:26]}


def test_actions_are_controls_and_then_forces() -> None:
    space = action_space(MIXED, external_force=True)
    assert space.names[:3] == ("ctrl.muscle", "ctrl.actuator1", "ctrl.servo")
    assert space.names[3:] == tuple(name.replace("qvel.", "qfrc.") for name in state_space(MIXED).names[14:26])
    assert (space.low[1].item(), space.high[1].item()) == (-2.0, 3.0)
    assert space.low[3:].tolist() == [-math.inf] * MIXED.nv
    assert action_space(MIXED).names == space.names[:3]


def test_an_actuator_of_several_inputs_numbers_them() -> None:
    model = mujoco.MjModel.from_xml_string("""
<mujoco><worldbody><body><joint name="a"/><geom size=".1"/></body></worldbody>
<actuator><pid name="pd" joint="a" kp="1" kv="1" input="pos vel"/><motor name="m" joint="a"/></actuator></mujoco>""")
    assert action_space(model).names == ("ctrl.pd.0", "ctrl.pd.1", "ctrl.m")


def test_names_agree_with_the_engine() -> None:
    data = mujoco.MjData(MIXED)
    space = state_space(MIXED)
    data.joint("wheel").qpos[:] = 7.0
    data.joint("wheel").qvel[:] = 8.0
    data.act[MIXED.actuator("servo").actadr] = 9.0
    state = np.concatenate([data.qpos, data.qvel, data.act])
    assert [state[space.names.index(name)] for name in ("qpos.wheel", "qvel.wheel", "act.servo")] == [7.0, 8.0, 9.0]


def test_the_caller_chooses_angles_and_bounds() -> None:
    assert state_space(MIXED, angles=[]).angles == ()
    space = state_space(MIXED, angles=["joint4", "wheel"], bounds={"qvel": (-9.0, 9.0), "qvel.wheel": (-1.0, 2.0)})
    assert [space.names[index] for index in space.angles] == ["qpos.wheel", "qpos.joint4"]
    assert space.high[14:26].tolist() == [9.0] * 10 + [2.0, 9.0]
    forces = action_space(MIXED, external_force=True, bounds={"qfrc.base": (-1.0, 1.0)})
    assert forces.high[3:9].tolist() == [1.0] * 6
    assert forces.high[9:].tolist() == [math.inf] * 6


HINGE = """<mujoco><worldbody><body><joint name="h" type="hinge" {joint}/><geom size=".1"/></body>
<body pos="0 1 0"><joint name="other" type="hinge"/><geom size=".1"/></body></worldbody>{rest}</mujoco>"""


@pytest.mark.parametrize(
    ("joint", "rest", "is_angle"),
    [
        ("", "", True),
        ("damping='1' frictionloss='1'", "", True),
        ("", "<actuator><motor joint='h'/></actuator>", True),
        ("", "<actuator><velocity joint='h' kv='1'/></actuator>", True),
        ("", "<actuator><damper joint='h' kv='1' ctrlrange='0 1'/></actuator>", True),
        ("", "<actuator><position joint='other' kp='1'/></actuator>", True),
        ("", "<actuator><position joint='h' kp='1'/></actuator>", False),
        ("", "<actuator><general joint='h' gaintype='affine' gainprm='1 2 0'/></actuator>", False),
        ("", "<actuator><muscle joint='h' lengthrange='0 1'/></actuator>", False),
        ("stiffness='1'", "", False),
        ("limited='true' range='-300 300'", "", False),
        ("", "<tendon><fixed><joint joint='h' coef='1'/></fixed></tendon>", False),
        ("", "<equality><joint joint1='h' joint2='other'/></equality>", False),
        ("", "<equality><joint joint1='other' joint2='h'/></equality>", False),
    ],
)
def test_a_hinge_is_an_angle_only_where_a_turn_changes_nothing(joint: str, rest: str, is_angle: bool) -> None:
    model = mujoco.MjModel.from_xml_string(HINGE.format(joint=joint, rest=rest))
    assert (0 in state_space(model).angles) == is_angle


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: state_space(MIXED, angles=["lift"]), r"no hinge joint \['lift'\].*\['wheel', 'joint4'\]"),
        (lambda: state_space(MIXED, bounds={"qve": (0, 1)}), "no dimension `qve`; the dimensions are qpos.base.x"),
        (lambda: action_space(MIXED, bounds={"qfrc": (0, 1)}), "no dimension `qfrc`.*ctrl.muscle"),
    ],
)
def test_errors_say_what_is_wrong(build, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        build()
