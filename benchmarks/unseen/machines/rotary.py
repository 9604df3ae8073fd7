"""Machines that turn: an antenna, a gimbal, a valve, a door."""

import numpy as np

from benchmarks.unseen.machine import Drive, Joint, Machine, Motor
from benchmarks.unseen.noise import Noise
from benchmarks.unseen.solids import box, cylinder, explicit
from benchmarks.unseen.tree import turn

ANTENNA = Machine(
    name="antenna",
    about="Azimuth-elevation mount of a dish, two geared motors, closed loop tracking; MJCF in degrees, explicit "
    "inertials; the recordings are in degrees and milliseconds, with a column map.",
    text="""
<mujoco model="antenna">
  <compiler angle="degree" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="pedestal" pos="0 0 1.2">
      <inertial pos="0.02 0 0.3" mass="40" diaginertia="2.1 2.3 1.6"/>
      <joint name="azimuth" axis="0 0 1" damping="$damping_azimuth" armature="$armature_azimuth"/>
      <body name="dish" pos="0 0 0.8">
        <inertial pos="0.22 0 0.04" mass="18" fullinertia="1.4 0.9 0.95 0 0.06 0"/>
        <joint name="elevation" axis="0 -1 0" range="-5 95" damping="$damping_elevation"
               armature="$armature_elevation"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="az_motor" joint="azimuth" gear="$gear_az_motor" ctrlrange="-3 3"/>
    <motor name="el_motor" joint="elevation" gear="$gear_el_motor" ctrlrange="-3 3"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("azimuth", "pedestal", (0, 0, 1), explicit(40, (0.02, 0, 0.3), (2.1, 2.3, 1.6)), pos=(0, 0, 1.2),
              armature=3.0, damping=4.0, tip=(0.3, 0, 0.5)),
        Joint("elevation", "dish", (0, -1, 0), explicit(18, (0.22, 0, 0.04), (1.4, 0.9, 0.95, 0, 0.06, 0)), "azimuth",
              pos=(0, 0, 0.8), armature=1.2, damping=2.5, tip=(0.6, 0, 0), limits=tuple(np.deg2rad([-5, 95]))),
    ),
    motors=(Motor("az_motor", "azimuth", 60, limit=3), Motor("el_motor", "elevation", 60, limit=3)),
    drive=Drive(("track", "tracksteps", "trackchirp", "dither"), (0.25, 0.2), (0.1, 1.6), (0.0, 0.75), (0.5, 0.12),
                travel=(0.35, 0.22), kp=(14.0, 9.0), kd=(2.2, 1.4), holds=True),
    noise=(Noise(5e-5), Noise(5e-5)),
    dt=0.01, seconds=5.0, runs=6, step=0.005,
    columns="""time = { column = "t_ms", unit = "ms" }
qpos.azimuth = { column = "az_deg", unit = "deg" }
qpos.elevation = { column = "el_deg", unit = "deg" }
ctrl.az_motor = "az_cmd"
ctrl.el_motor = "el_cmd"
""",
)  # fmt: skip

GIMBAL = Machine(
    name="gimbal",
    about="Camera gimbal, yaw-roll-pitch nested, slightly out of balance, direct-drive motors, 500 Hz; explicit "
    "inertials with full tensors, a default class, frames turned by quaternions.",
    text="""
<mujoco model="gimbal">
  <compiler angle="radian"/>
  <option timestep="0.001" integrator="RK4"/>
  <default>
    <default class="frame"><joint damping="0.004"/></default>
  </default>
  <worldbody>
    <body name="outer" childclass="frame">
      <inertial pos="-0.01 0.004 0.02" mass="0.34" diaginertia="0.0011 0.0013 0.0009"/>
      <joint name="yaw" axis="0 0 1" armature="$armature_yaw" damping="$damping_yaw"/>
      <body name="middle" pos="-0.05 0 0.06" quat="0.7071067811865476 0.7071067811865475 0 0">
        <inertial pos="0.02 0.006 0.003" mass="0.22" fullinertia="0.0005 0.0006 0.0004 0.00004 0 0.00002"/>
        <joint name="roll" axis="1 0 0" armature="$armature_roll" damping="$damping_roll"/>
        <body name="camera" pos="0.05 0 0">
          <inertial pos="0.012 0.009 -0.004" mass="0.48" fullinertia="0.0007 0.0008 0.0006 0 0.00005 0"/>
          <joint name="pitch" axis="0 0 -1" armature="$armature_pitch" damping="$damping_pitch"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="m_yaw" joint="yaw" gear="$gear_m_yaw"/>
    <motor name="m_roll" joint="roll" gear="$gear_m_roll"/>
    <motor name="m_pitch" joint="pitch" gear="$gear_m_pitch"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("yaw", "outer", (0, 0, 1), explicit(0.34, (-0.01, 0.004, 0.02), (0.0011, 0.0013, 0.0009)),
              armature=2e-4, damping=0.004, tip=(0.04, 0, 0)),
        Joint("roll", "middle", (1, 0, 0), explicit(0.22, (0.02, 0.006, 0.003), (5e-4, 6e-4, 4e-4, 4e-5, 0, 2e-5)),
              "yaw", pos=(-0.05, 0, 0.06), rot=turn((1, 0, 0), 90), armature=2e-4, damping=0.004, tip=(0, 0.04, 0)),
        Joint("pitch", "camera", (0, 0, -1), explicit(0.48, (0.012, 0.009, -0.004), (7e-4, 8e-4, 6e-4, 0, 5e-5, 0)),
              "roll", pos=(0.05, 0, 0), armature=2e-4, damping=0.005, tip=(0.05, 0, 0)),
    ),
    motors=(Motor("m_yaw", "yaw", 0.8), Motor("m_roll", "roll", 0.8), Motor("m_pitch", "pitch", 0.8)),
    drive=Drive(("track", "dither", "trackchirp", "tracksteps"), (0.05, 0.05, 0.05), (0.4, 6.0), (0.0, 0.0, 0.0),
                (0.4, 0.2, 0.2), travel=(0.5, 0.3, 0.3), kp=(0.9, 0.8, 0.6), kd=(0.07, 0.06, 0.05), holds=True),
    noise=(Noise(1e-4), Noise(1e-4), Noise(1e-4)),
    dt=0.002, seconds=3.0, runs=5, step=0.002,
)  # fmt: skip

VALVE = Machine(
    name="valve",
    about="Butterfly valve with a return spring and a tight packing: hard dry friction is in the nominal model "
    "(frictionloss, with MuJoCo's default softness), and it sticks and slips; a fine encoder, 200 Hz.",
    text="""
<mujoco model="throttle">
  <compiler angle="degree" inertiafromgeom="true"/>
  <option timestep="0.001"/>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="disc">
      <joint name="stem" axis="0 1 0" stiffness="1.4" springref="-20" limited="true" range="-80 80"
             damping="$damping_stem" armature="$armature_stem" frictionloss="0.12"/>
      <geom type="cylinder" size="0.06 0.004" mass="0.42" pos="0.008 0 0"/>
      <geom type="box" size="0.006 0.08 0.006" mass="0.16"/>
    </body>
  </worldbody>
  <actuator>
    <general name="motor" joint="stem" gear="12" gainprm="$gain_motor" biastype="none" ctrlrange="-1 1"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("stem", "disc", (0, 1, 0),
              cylinder(0.42, 0.06, 0.004, 2, (0.008, 0, 0)) + box(0.16, (0.006, 0.08, 0.006)),
              armature=0.012, damping=0.03, frictionloss=0.12, stiffness=1.4, springref=float(np.deg2rad(-20)),
              limits=tuple(np.deg2rad([-80, 80])), tip=(0.06, 0, 0)),
    ),
    motors=(Motor("motor", "stem", 12, 0.3, limit=1),),
    drive=Drive(("multisine", "steps", "chirp", "track", "slow"), (0.17,), (0.15, 2.0), (0.0,), (0.3,), travel=(0.5,),
                kp=(1.2,), kd=(0.06,)),
    noise=(Noise(5e-5),),
    dt=0.005, seconds=5.0, runs=6, step=0.005,
    same=((("actuator_delay", "actuator:motor"), ("sensor_delay", "sensor:stem"), ("sensor_delay", "joint:stem")),),
)  # fmt: skip

DOOR = Machine(
    name="door",
    about="Swing door with a closer spring and a door operator, about a vertical axis; degrees, mass from density, "
    "wandering (low-pass filtered) errors, 50 Hz.",
    text="""
<mujoco model="door">
  <compiler angle="degree"/>
  <option timestep="0.002" integrator="implicit"/>
  <worldbody>
    <body name="leaf" pos="0 0 1">
      <joint name="hinge" type="hinge" axis="0 0 1" pos="0 0 0" range="-110 110" limited="true" stiffness="8"
             springref="-15" damping="$damping_hinge" armature="$armature_hinge"/>
      <geom type="box" pos="0.45 0 0" size="0.45 0.02 1" density="700"/>
    </body>
  </worldbody>
  <actuator>
    <general name="operator" joint="hinge" gainprm="$gain_operator" biastype="affine" biasprm="$bias_operator 0 0"
             ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("hinge", "leaf", (0, 0, 1), box(0.9 * 0.04 * 2 * 700, (0.45, 0.02, 1), (0.45, 0, 0)), pos=(0, 0, 1),
              armature=1.5, damping=9.0, stiffness=8.0, springref=float(np.deg2rad(-15)), tip=(0.85, 0, 0),
              limits=tuple(np.deg2rad([-110, 110]))),
    ),
    motors=(Motor("operator", "hinge", 1.0, 40.0, limit=1),),
    drive=Drive(("multisine", "steps", "chirp", "prbs"), (0.33,), (0.1, 1.2), (0.1,), (0.4,)),
    noise=(Noise(1e-3, memory=0.03),),
    dt=0.02, seconds=6.0, runs=7, step=0.01,
    same=((("armature_error", "joint:hinge"), ("payload_mass", "body:leaf")),
          (("actuator_delay", "actuator:operator"), ("sensor_delay", "sensor:hinge"), ("sensor_delay", "joint:hinge"))),
)  # fmt: skip
