"""Arms: a finger, an excavator, a hexapod's leg, a polar robot, seven joints."""

import numpy as np

from benchmarks.unseen.machine import Drive, Joint, Machine, Motor
from benchmarks.unseen.noise import Noise
from benchmarks.unseen.solids import box, capsule, capsule_mass, cylinder, explicit, sphere

F1, F2, F3 = (capsule_mass(1400.0, r, x) for r, x in ((0.009, 0.045), (0.008, 0.03), (0.007, 0.022)))
FINGER = Machine(
    name="finger",
    about="A robot finger: three joints in a plane, position servos, return springs at rest bent (springref); capsules "
    "by density, default classes, 250 Hz.",
    text="""
<mujoco model="finger">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <default>
    <default class="phalanx">
      <joint type="hinge" axis="0 1 0" stiffness="0.02" springref="0.3"/>
      <geom type="capsule" density="1400" contype="0" conaffinity="0"/>
    </default>
    <default class="servo"><position kv="0" ctrlrange="-1.5 2"/></default>
  </default>
  <worldbody>
    <body name="proximal" childclass="phalanx" pos="0 0 0.1">
      <joint name="mcp" damping="$damping_mcp" armature="$armature_mcp"/>
      <geom fromto="0 0 0 0.045 0 0" size="0.009"/>
      <body name="middle" pos="0.045 0 0">
        <joint name="pip" damping="$damping_pip" armature="$armature_pip"/>
        <geom fromto="0 0 0 0.03 0 0" size="0.008"/>
        <body name="distal" pos="0.03 0 0">
          <joint name="dip" damping="$damping_dip" armature="$armature_dip"/>
          <geom fromto="0 0 0 0.022 0 0" size="0.007"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position class="servo" name="s_mcp" joint="mcp" kp="$kp_s_mcp"/>
    <position class="servo" name="s_pip" joint="pip" kp="$kp_s_pip"/>
    <position class="servo" name="s_dip" joint="dip" kp="$kp_s_dip"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("mcp", "proximal", (0, 1, 0), capsule(F1, 0.009, (0, 0, 0), (0.045, 0, 0)), pos=(0, 0, 0.1),
              stiffness=0.02, springref=0.3, damping=0.006, armature=2e-4, tip=(0.04, 0, 0)),
        Joint("pip", "middle", (0, 1, 0), capsule(F2, 0.008, (0, 0, 0), (0.03, 0, 0)), "mcp", pos=(0.045, 0, 0),
              stiffness=0.02, springref=0.3, damping=0.004, armature=1.2e-4, tip=(0.03, 0, 0)),
        Joint("dip", "distal", (0, 1, 0), capsule(F3, 0.007, (0, 0, 0), (0.022, 0, 0)), "pip", pos=(0.03, 0, 0),
              stiffness=0.02, springref=0.3, damping=0.003, armature=8e-5, tip=(0.025, 0, 0)),
    ),
    motors=(Motor("s_mcp", "mcp", kp=0.22), Motor("s_pip", "pip", kp=0.15), Motor("s_dip", "dip", kp=0.1)),
    drive=Drive(("multisine", "steps", "chirp", "prbs"), (0.45, 0.45, 0.4), (0.3, 4.0), (0.2, 0.3, 0.2),
                (0.3, 0.3, 0.3)),
    noise=(Noise(4e-4), Noise(4e-4), Noise(4e-4)),
    dt=0.004, seconds=3.0, runs=6, step=0.004,
)  # fmt: skip

EXCAVATOR = Machine(
    name="excavator",
    about="Boom, stick and bucket of a small excavator, hydraulic drives as general actuators with a gain and a bias; "
    "degrees, boxes with masses, encoder counts with a column map, 100 Hz, closed loop.",
    text="""
<mujoco model="mini excavator">
  <compiler angle="degree"/>
  <option timestep="0.005" integrator="implicitfast"/>
  <default><joint type="hinge" axis="0 -1 0" limited="true"/></default>
  <worldbody>
    <body name="boom" pos="0 0 0.5">
      <joint name="boom" range="-20 80" damping="$damping_boom" armature="$armature_boom"/>
      <geom type="box" pos="0.9 0 0.05" size="0.9 0.08 0.1" mass="95"/>
      <body name="stick" pos="1.8 0 0.1">
        <joint name="stick" range="-150 -10" damping="$damping_stick" armature="$armature_stick"/>
        <geom type="box" pos="0.5 0 0" size="0.55 0.06 0.07" mass="42"/>
        <body name="bucket" pos="1.05 0 0">
          <joint name="bucket" range="-120 50" damping="$damping_bucket" armature="$armature_bucket"/>
          <geom type="box" pos="0.2 0 -0.12" size="0.2 0.22 0.15" mass="34"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <general name="boom_cyl" joint="boom" gainprm="$gain_boom_cyl" biastype="affine" biasprm="$bias_boom_cyl 0 0"/>
    <general name="stick_cyl" joint="stick" gainprm="$gain_stick_cyl" biastype="affine" biasprm="$bias_stick_cyl 0 0"/>
    <general name="bucket_cyl" joint="bucket"
             gainprm="$gain_bucket_cyl" biastype="affine" biasprm="$bias_bucket_cyl 0 0"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("boom", "boom", (0, -1, 0), box(95, (0.9, 0.08, 0.1), (0.9, 0, 0.05)), pos=(0, 0, 0.5), armature=25,
              damping=320, limits=tuple(np.deg2rad([-20, 80])), tip=(1.6, 0, 0.1)),
        Joint("stick", "stick", (0, -1, 0), box(42, (0.55, 0.06, 0.07), (0.5, 0, 0)), "boom", pos=(1.8, 0, 0.1),
              armature=8, damping=110, limits=tuple(np.deg2rad([-150, -10])), tip=(1.0, 0, 0)),
        Joint("bucket", "bucket", (0, -1, 0), box(34, (0.2, 0.22, 0.15), (0.2, 0, -0.12)), "stick", pos=(1.05, 0, 0),
              armature=2.5, damping=35, limits=tuple(np.deg2rad([-120, 50])), tip=(0.3, 0, -0.2)),
    ),
    motors=(Motor("boom_cyl", "boom", 1, 2500, bias=600), Motor("stick_cyl", "stick", 1, 900, bias=100),
            Motor("bucket_cyl", "bucket", 1, 260)),
    drive=Drive(("track", "trackchirp", "tracksteps", "dither"), (0.25, 0.25, 0.25), (0.15, 1.3), (0.6, -1.3, -0.5),
                (0.08, 0.12, 0.2), travel=(0.13, 0.22, 0.3), kp=(3.5, 3.0, 2.5), kd=(0.8, 0.5, 0.3), holds=True),
    noise=(Noise(2e-4, 2 * np.pi / 8192), Noise(2e-4, 2 * np.pi / 8192), Noise(2e-4, 2 * np.pi / 8192)),
    dt=0.01, seconds=5.0, runs=6, step=0.005,
    columns="""time = "stamp"
qpos.boom = { column = "enc_boom", unit = "counts", counts_per_turn = 8192 }
qpos.stick = { column = "enc_stick", unit = "counts", counts_per_turn = 8192 }
qpos.bucket = { column = "enc_bucket", unit = "counts", counts_per_turn = 8192 }
ctrl.boom_cyl = "valve_boom"
ctrl.stick_cyl = "valve_stick"
ctrl.bucket_cyl = "valve_bucket"
""",
)  # fmt: skip

STEP12 = 2 * np.pi / 4096
LEG = Machine(
    name="hexleg",
    about="A leg of a hexapod: coxa, femur, tibia with hobby servos (position actuators with kp and kv), 12-bit "
    "encoders, 200 Hz; capsules with masses, nested bodies turned by euler angles in degrees.",
    text="""
<mujoco model="hexapod leg">
  <compiler angle="degree" eulerseq="xyz"/>
  <option timestep="0.0025" integrator="implicitfast"/>
  <default>
    <geom type="capsule" size="0.012"/>
    <position kv="0.12"/>
  </default>
  <worldbody>
    <body name="coxa" pos="0 0 0.15">
      <joint name="coxa" axis="0 0 1" range="-70 70" damping="$damping_coxa" armature="$armature_coxa"/>
      <geom fromto="0 0 0 0.05 0 0" mass="0.09"/>
      <body name="femur" pos="0.05 0 0" euler="90 0 0">
        <joint name="femur" axis="0 0 1" range="-90 90" damping="$damping_femur" armature="$armature_femur"/>
        <geom fromto="0 0 0 0.09 0 0" mass="0.14"/>
        <body name="tibia" pos="0.09 0 0">
          <joint name="tibia" axis="0 0 1" range="-150 0" damping="$damping_tibia" armature="$armature_tibia"/>
          <geom fromto="0 0 0 0.13 0 0" size="0.009" mass="0.11"/>
          <geom type="sphere" size="0.015" pos="0.14 0 0" mass="0.03"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="servo1" joint="coxa" kp="$kp_servo1"/>
    <position name="servo2" joint="femur" kp="$kp_servo2"/>
    <position name="servo3" joint="tibia" kp="$kp_servo3"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("coxa", "coxa", (0, 0, 1), capsule(0.09, 0.012, (0, 0, 0), (0.05, 0, 0)), pos=(0, 0, 0.15),
              damping=0.05, armature=0.003, limits=tuple(np.deg2rad([-70, 70])), tip=(0.05, 0, 0)),
        Joint("femur", "femur", (0, 0, 1), capsule(0.14, 0.012, (0, 0, 0), (0.09, 0, 0)), "coxa", pos=(0.05, 0, 0),
              rot=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), damping=0.05, armature=0.003,
              limits=tuple(np.deg2rad([-90, 90])), tip=(0.08, 0, 0)),
        Joint("tibia", "tibia", (0, 0, 1),
              capsule(0.11, 0.009, (0, 0, 0), (0.13, 0, 0)) + sphere(0.03, 0.015, (0.14, 0, 0)), "femur",
              pos=(0.09, 0, 0), damping=0.04, armature=0.002, limits=tuple(np.deg2rad([-150, 0])), tip=(0.14, 0, 0)),
    ),
    motors=(Motor("servo1", "coxa", kp=5.0, kv=0.12), Motor("servo2", "femur", kp=5.0, kv=0.12),
            Motor("servo3", "tibia", kp=3.0, kv=0.12)),
    drive=Drive(("multisine", "steps", "chirp", "prbs"), (0.5, 0.4, 0.5), (0.3, 4.0), (0.0, 0.4, -1.3),
                (0.2, 0.2, 0.2)),
    noise=(Noise(4e-4, STEP12), Noise(4e-4, STEP12), Noise(4e-4, STEP12)),
    dt=0.005, seconds=4.0, runs=6, step=0.0025,
)  # fmt: skip

POLAR = Machine(
    name="polar",
    about="A polar robot: a turning base, a tilting arm, and a carriage that slides along it; geared motors, closed "
    "loop, 200 Hz; boxes and cylinders by mass, radians, wandering (low-pass filtered) encoder errors.",
    text="""
<mujoco model="polar">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="Euler"/>
  <worldbody>
    <body name="column" pos="0 0 0.4">
      <joint name="base" axis="0 0 1" damping="$damping_base" armature="$armature_base"/>
      <geom type="cylinder" size="0.09 0.2" mass="11"/>
      <body name="arm" pos="0 0 0.25">
        <joint name="tilt" axis="0 -1 0" damping="$damping_tilt" armature="$armature_tilt"/>
        <geom type="box" size="0.3 0.05 0.04" pos="0.12 0 0" mass="5"/>
        <body name="carriage" pos="0.35 0 0.06">
          <joint name="reach" type="slide" axis="1 0 0" damping="$damping_reach" armature="$armature_reach"/>
          <geom type="box" size="0.12 0.03 0.03" mass="2.4"/>
          <geom type="sphere" size="0.04" pos="0.15 0 0.01" mass="0.8"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="base_motor" joint="base" gear="$gear_base_motor"/>
    <motor name="tilt_motor" joint="tilt" gear="$gear_tilt_motor"/>
    <motor name="reach_motor" joint="reach" gear="$gear_reach_motor"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("base", "column", (0, 0, 1), cylinder(11, 0.09, 0.2), pos=(0, 0, 0.4), armature=0.3, damping=0.8,
              tip=(0.1, 0, 0)),
        Joint("tilt", "arm", (0, -1, 0), box(5, (0.3, 0.05, 0.04), (0.12, 0, 0)), "base", pos=(0, 0, 0.25),
              armature=0.25, damping=0.9, tip=(0.4, 0, 0)),
        Joint("reach", "carriage", (1, 0, 0), box(2.4, (0.12, 0.03, 0.03)) + sphere(0.8, 0.04, (0.15, 0, 0.01)),
              "tilt", hinge=False, pos=(0.35, 0, 0.06), armature=1.5, damping=9.0, tip=(0.18, 0, 0)),
    ),
    motors=(Motor("base_motor", "base", 10.0), Motor("tilt_motor", "tilt", 14.0), Motor("reach_motor", "reach", 30.0)),
    drive=Drive(("track", "dither", "trackchirp", "tracksteps"), (0.25, 0.2, 0.3), (0.2, 2.2), (0.0, 0.3, 0.0),
                (0.4, 0.15, 0.04), travel=(0.5, 0.25, 0.08), kp=(12.0, 9.0, 16.0), kd=(1.8, 1.3, 2.0), holds=True),
    noise=(Noise(2e-4, memory=0.01), Noise(2e-4, memory=0.01), Noise(1e-4, memory=0.01)),
    dt=0.005, seconds=4.0, runs=6, step=0.005,
)  # fmt: skip

_AXES = [(0, 0, 1), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)]
_POS = [(0, 0, 0.3), (0, 0, 0.04), (0, 0, 0.2), (0.02, 0, 0.2), (-0.02, 0, 0.18), (0, 0, 0.2), (0.05, 0, 0.06)]
_MASS = [3.4, 3.2, 2.4, 2.2, 1.6, 1.2, 0.6]
_COM = [(0, -0.02, 0.01), (0, 0.01, 0.1), (0.01, 0, 0.1), (-0.01, 0, 0.09), (0, 0.01, 0.1), (0.03, 0, 0.02),
        (0, 0.01, 0.04)]  # fmt: skip
_INERTIA = [(0.014, 0.014, 0.009), (0.03, 0.028, 0.008), (0.02, 0.02, 0.006), (0.016, 0.016, 0.005),
            (0.011, 0.01, 0.003),
            (0.003, 0.004, 0.003), (0.0012, 0.0012, 0.0008)]  # fmt: skip
_KP, _KV = [260, 420, 180, 220, 60, 60, 18], [12, 22, 8, 12, 2, 2, 0.5]
_ARM, _DAMP = [0.6, 0.6, 0.35, 0.35, 0.1, 0.1, 0.05], [3, 4, 2, 2.5, 0.6, 0.6, 0.25]


def _seven() -> str:
    """Nested bodies by rule."""
    inner = ""
    for i in reversed(range(7)):
        pos, com, tensor, axis = (" ".join(f"{x:g}" for x in y[i]) for y in (_POS, _COM, _INERTIA, _AXES))
        inner = (
            f'<body name="link{i + 1}" pos="{pos}">\n<inertial pos="{com}" mass="{_MASS[i]}" diaginertia="{tensor}"/>\n'
            f'<joint name="j{i + 1}" axis="{axis}" damping="$damping_j{i + 1}" armature="$armature_j{i + 1}"/>\n'
            f"{inner}</body>\n"
        )
    drives = "".join(
        f'    <general name="a{i + 1}" joint="j{i + 1}" gainprm="$kp_a{i + 1}" biasprm="0 -$kp_a{i + 1} -{_KV[i]}"/>\n'
        for i in range(7)
    )
    return f"""
<mujoco model="seven axes">
  <option timestep="0.002" integrator="implicitfast"/>
  <default><general biastype="affine"/></default>
  <worldbody>
{inner}  </worldbody>
  <actuator>
{drives}  </actuator>
</mujoco>"""


SEVEN = Machine(
    name="arm7",
    about="A lightweight arm of seven joints with affine general actuators (position gains), explicit inertials, "
    "no meshes; 125 Hz.",
    text=_seven(),
    joints=tuple(
        Joint(f"j{i + 1}", f"link{i + 1}", _AXES[i], explicit(_MASS[i], _COM[i], _INERTIA[i]), f"j{i}" if i else "",
              pos=_POS[i], armature=_ARM[i], damping=_DAMP[i], tip=(0.05, 0, 0.1))
        for i in range(7)
    ),
    motors=tuple(Motor(f"a{i + 1}", f"j{i + 1}", kp=_KP[i], kv=_KV[i]) for i in range(7)),
    drive=Drive(("multisine", "steps", "chirp"), (0.4, 0.3, 0.4, 0.35, 0.5, 0.5, 0.6), (0.15, 1.6),
                (0.0, 0.5, 0.0, 0.9, 0.0, 0.6, 0.0), (0.2,) * 7),
    noise=(Noise(1e-4),) * 7,
    dt=0.008, seconds=4.0, runs=5, step=0.004,
)  # fmt: skip
