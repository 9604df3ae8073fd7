"""Machines with a rail: a lift with a head, a trolley on a slope, a wheel on a sprung leg."""

from benchmarks.unseen.machine import Drive, Joint, Machine, Motor
from benchmarks.unseen.noise import Noise
from benchmarks.unseen.solids import box, cylinder, explicit, sphere
from benchmarks.unseen.tree import turn

LIFT = Machine(
    name="lift",
    about="Vertical axis that carries a load and a turning head: hard dry friction on both joints is in the nominal "
    "model (frictionloss, made stiff by solreffriction), and it sticks and slips; fine encoders, 250 Hz, closed loop.",
    text="""
<mujoco model="z-axis with flipping head">
  <compiler angle="radian" autolimits="false"/>
  <option timestep="0.001" integrator="implicitfast"/>
  <default>
    <joint solreffriction="0.004 1" solimpfriction="0.99 0.999 0.001 0.5 2"/>
  </default>
  <worldbody>
    <body name="carriage" pos="0.1 0 0.5">
      <inertial pos="0 0 0.05" mass="9" diaginertia="0.1 0.1 0.06"/>
      <joint name="lift" type="slide" axis="0 0 1" damping="$damping_lift" armature="$armature_lift"
             frictionloss="14"/>
      <body name="head" pos="0.12 0 0.02">
        <inertial pos="0.02 0.05 0" mass="2.2" diaginertia="0.008 0.011 0.012"/>
        <joint name="flip" type="hinge" axis="1 0 0" damping="$damping_flip" armature="$armature_flip"
               frictionloss="0.15"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="lift_motor" joint="lift" gear="$gear_lift_motor"/>
    <motor name="flip_motor" joint="flip" gear="$gear_flip_motor"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("lift", "carriage", (0, 0, 1), explicit(9, (0, 0, 0.05), (0.1, 0.1, 0.06)), hinge=False,
              pos=(0.1, 0, 0.5), armature=12.0, damping=35.0, frictionloss=14.0),
        Joint("flip", "head", (1, 0, 0), explicit(2.2, (0.02, 0.05, 0), (0.008, 0.011, 0.012)), "lift",
              pos=(0.12, 0, 0.02), armature=0.01, damping=0.03, frictionloss=0.15, tip=(0, 0.1, 0)),
    ),
    motors=(Motor("lift_motor", "lift", 45.0), Motor("flip_motor", "flip", 1.8)),
    drive=Drive(("track", "slow", "tracksteps", "dither", "trackchirp"), (0.5, 0.4), (0.2, 2.0), (0.0, 0.0),
                (0.05, 0.6), travel=(0.05, 0.6), kp=(120.0, 3.0), kd=(12.0, 0.25), holds=True),
    noise=(Noise(2e-5), Noise(5e-5)),
    dt=0.004, seconds=4.0, runs=6, step=0.004,
    same=((("gravity_error", "world"), ("constant_force", "joint:lift")),),
)  # fmt: skip

SLOPE = 12.0
TROLLEY = Machine(
    name="trolley",
    about="A trolley on a sloping rail with a load on a sling; 50 Hz with an irregular clock (true time stamps), "
    "camera-class noise, closed loop on the rail.",
    text="""
<mujoco model="yarder">
  <option timestep="0.002" integrator="RK4"/>
  <worldbody>
    <body name="carrier" euler="0 -12 0">
      <joint name="trolley" type="slide" axis="1 0 0" damping="$damping_trolley" armature="$armature_trolley"/>
      <geom type="box" size="0.2 0.1 0.05" mass="14"/>
      <body name="load" pos="0 0 -0.05" euler="0 12 0">
        <joint name="sling" axis="0 1 0" damping="$damping_sling" armature="$armature_sling"/>
        <geom type="cylinder" fromto="0 0 0 0 0 -1.1" size="0.01" mass="0.6"/>
        <geom type="sphere" pos="0.03 0 -1.2" size="0.11" mass="6"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="winch" joint="trolley" gear="$gear_winch"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("trolley", "carrier", (1, 0, 0), box(14, (0.2, 0.1, 0.05)), hinge=False, rot=turn((0, 1, 0), -SLOPE),
              armature=3.0, damping=18.0),
        Joint("sling", "load", (0, 1, 0),
              cylinder(0.6, 0.01, 0.55, 2, (0, 0, -0.55)) + sphere(6, 0.11, (0.03, 0, -1.2)), "trolley",
              pos=(0, 0, -0.05), rot=turn((0, 1, 0), SLOPE), armature=0.0, damping=0.08, tip=(0, 0, -1.35)),
    ),
    motors=(Motor("winch", "trolley", 100.0),),
    drive=Drive(("track", "dither", "tracksteps", "trackchirp"), (0.35,), (0.1, 1.2), (0.0, 0.0), (0.2, 0.25),
                travel=(0.4,), kp=(2.5,), kd=(1.2,), holds=True),
    noise=(Noise(1e-3), Noise(2e-3)),
    dt=0.02, seconds=6.0, runs=8, step=0.007, jitter=0.25,
)  # fmt: skip

WHEEL = Machine(
    name="wheelleg",
    about="A wheel with an unbalance on a sprung vertical leg: a linear actuator on the leg, a motor in the hub; steps "
    "and random telegraph signals at 100 Hz, mass from geoms, radians.",
    text="""
<mujoco model="hopper rig">
  <compiler angle="radian" inertiafromgeom="auto"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="leg" pos="0 0 0.6">
      <joint name="slide" type="slide" axis="0 0 1" stiffness="1200" springref="0.04" damping="$damping_slide"
             armature="$armature_slide"/>
      <geom type="box" size="0.04 0.04 0.2" mass="4.5"/>
      <body name="wheel" pos="0 0.08 -0.2">
        <joint name="axle" type="hinge" axis="0 1 0" damping="$damping_axle" armature="$armature_axle"/>
        <geom type="cylinder" zaxis="0 1 0" size="0.12 0.02" mass="1.6"/>
        <geom type="sphere" size="0.02" pos="0.07 0 0" mass="0.25"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="lift_act" joint="slide" gear="$gear_lift_act" ctrlrange="-1 1"/>
    <motor name="hub" joint="axle" gear="$gear_hub" ctrlrange="-1 1"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("slide", "leg", (0, 0, 1), box(4.5, (0.04, 0.04, 0.2)), hinge=False, pos=(0, 0, 0.6), armature=0.8,
              damping=28.0, stiffness=1200.0, springref=0.04),
        Joint("axle", "wheel", (0, 1, 0), cylinder(1.6, 0.12, 0.02, 1) + sphere(0.25, 0.02, (0.07, 0, 0)), "slide",
              pos=(0, 0.08, -0.2), armature=0.004, damping=0.03, tip=(0.1, 0, 0)),
    ),
    motors=(Motor("lift_act", "slide", 80.0, limit=1), Motor("hub", "axle", 1.2, limit=1)),
    drive=Drive(("prbs", "steps", "multisine", "chirp"), (0.45, 0.3), (0.3, 4.0), (-0.005, 0.0), (0.01, 1.0)),
    noise=(Noise(5e-5), Noise(1e-3)),
    dt=0.01, seconds=4.0, runs=6, step=0.005,
)  # fmt: skip
