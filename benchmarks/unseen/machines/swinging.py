"""Machines that swing with fewer motors than joints: a reaction wheel pendulum, a leg on a test rig."""

from benchmarks.unseen.machine import Drive, Joint, Machine, Motor
from benchmarks.unseen.noise import Noise
from benchmarks.unseen.solids import box, capsule, capsule_mass, cylinder

REACTION = Machine(
    name="reaction",
    about="A hanging pole with a motor and a flywheel at its end; the motor turns the wheel against the pole; radians, "
    "capsules and cylinders with masses, 200 Hz.",
    text="""
<mujoco model="reaction wheel pendulum">
  <compiler angle="radian"/>
  <option timestep="0.0025" integrator="RK4"/>
  <worldbody>
    <body name="pole" pos="0 0 0.5">
      <joint name="pivot" axis="0 1 0" damping="$damping_pivot" armature="$armature_pivot"/>
      <geom type="capsule" fromto="0 0 0.02 0 0 -0.22" size="0.008" mass="0.12"/>
      <geom type="cylinder" pos="0 -0.03 -0.22" euler="1.5707963267948966 0 0" size="0.02 0.025" mass="0.19"/>
      <body name="flywheel" pos="0 0.02 -0.22">
        <joint name="wheel" axis="0 1 0" damping="$damping_wheel" armature="$armature_wheel"/>
        <geom type="cylinder" zaxis="0 1 0" size="0.07 0.006" mass="0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor" joint="wheel" gear="$gear_motor"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("pivot", "pole", (0, 1, 0), capsule(0.12, 0.008, (0, 0, 0.02), (0, 0, -0.22))
              + cylinder(0.19, 0.02, 0.025, 1, (0, -0.03, -0.22)), pos=(0, 0, 0.5), damping=0.002, tip=(0, 0, -0.2)),
        Joint("wheel", "flywheel", (0, 1, 0), cylinder(0.3, 0.07, 0.006, 1), "pivot", pos=(0, 0.02, -0.22),
              armature=2e-5, damping=8e-4),
    ),
    motors=(Motor("motor", "wheel", 0.05),),
    drive=Drive(("multisine", "chirp", "steps", "prbs"), (2.5,), (0.4, 2.2), (0.0, 0.0), (0.7, 1.0)),
    noise=(Noise(3e-4), Noise(2e-3)),
    dt=0.005, seconds=5.0, runs=6, step=0.0025,
)  # fmt: skip

SHANK = capsule_mass(900.0, 0.035, 0.34)
HIP = Machine(
    name="hip",
    about="A two-link leg that hangs from a test rig: a motor at the hip, a passive knee; boxes and capsules by "
    "density, default classes, 200 Hz.",
    text="""
<mujoco model="leg on a rig">
  <compiler angle="degree"/>
  <option timestep="0.005" integrator="RK4"/>
  <default>
    <geom density="900"/>
    <default class="passive"><joint damping="0.05" armature="0.002"/></default>
  </default>
  <worldbody>
    <body name="thigh" pos="0 0 1.1">
      <joint name="hip" axis="0 -1 0" damping="$damping_hip" armature="$armature_hip"/>
      <geom type="box" size="0.045 0.05 0.19" pos="0 0 -0.19"/>
      <body name="shank" pos="0.01 0 -0.4">
        <joint name="knee" class="passive" axis="0 -1 0" damping="$damping_knee" armature="$armature_knee"/>
        <geom type="capsule" fromto="0 0 0 0.02 0 -0.339411255" size="0.035"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="hip_motor" joint="hip" gear="$gear_hip_motor" ctrlrange="-1 1"/>
  </actuator>
</mujoco>""",
    joints=(
        Joint("hip", "thigh", (0, -1, 0), box(900 * 0.09 * 0.1 * 0.38, (0.045, 0.05, 0.19), (0, 0, -0.19)),
              pos=(0, 0, 1.1), armature=0.05, damping=0.5, tip=(0, 0, -0.3)),
        Joint("knee", "shank", (0, -1, 0), capsule(SHANK, 0.035, (0, 0, 0), (0.02, 0, -0.339411255)), "hip",
              pos=(0.01, 0, -0.4), armature=0.002, damping=0.05, tip=(0.02, 0, -0.34)),
    ),
    motors=(Motor("hip_motor", "hip", 22.0, limit=1),),
    drive=Drive(("multisine", "chirp", "steps", "prbs"), (0.12,), (0.3, 2.0), (0.0, 0.0), (0.35, 0.5)),
    noise=(Noise(5e-4), Noise(5e-4)),
    dt=0.005, seconds=5.0, runs=6, step=0.005,
)  # fmt: skip
