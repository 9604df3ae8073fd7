"""The machines: MJCF with sizes, names and losses drawn for each case."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

Generator = np.random.Generator


@dataclasses.dataclass(frozen=True)
class System:
    """What a case needs to know about a machine.

    Args:
        name: family of the machine.
        write: from a generator and the model's options to MJCF text.
        acceleration: typical accelerations that the motors reach, per joint kind, rad/s2 and m/s2.
        servo: whether controls are positions.
        closed: whether a feedback loop around its motors makes sense.
        spread: initial positions of a free swing, rad or m.
    """

    name: str
    write: Callable[[Generator], str]
    acceleration: tuple[float, float] = (15.0, 3.0)
    servo: bool = False
    closed: bool = True
    spread: float = 1.0


def _names(rng: Generator, *groups: str) -> list[str]:
    """One of several sets of names, each written as `a b c`."""
    return str(rng.choice(groups)).split()


def _losses(rng: Generator, inertia: float, armature: float = 0.6) -> str:
    """Damping with a decay of 0.1-1 per second and often a rotor inertia, as attributes of a joint."""
    text = f' damping="{inertia * rng.uniform(0.1, 1.0):.3g}"'
    if rng.random() < armature:
        text += f' armature="{inertia * rng.uniform(0.1, 0.5):.3g}"'
    return text


def _wrap(name: str, world: str, actuators: str, sensors: str, option: str = "") -> str:
    return (
        f'<mujoco model="{name}">\n  <compiler angle="radian"/>\n  <option OPTIONS{option}/>\n  <worldbody>\n{world}'
        f"  </worldbody>\n  <actuator>\n{actuators}  </actuator>\n  <sensor>\n{sensors}  </sensor>\n</mujoco>\n"
    )


def _sensors(joints: list[str]) -> str:
    return "".join(f'    <jointpos name="{joint}_encoder" joint="{joint}"/>\n' for joint in joints)


def _motors(motors: list[str], joints: list[str], gears: list[float]) -> str:
    rows = zip(motors, joints, gears, strict=True)
    return "".join(f'    <motor name="{motor}" joint="{joint}" gear="{gear:.3g}"/>\n' for motor, joint, gear in rows)


def _rod(length: float, mass: float, axis: str = "0 0 -1", radius: float = 0.02) -> str:
    x, y, z = (length * float(part) for part in axis.split())
    return f'<geom type="capsule" fromto="0 0 0 {x:.4g} {y:.4g} {z:.4g}" size="{radius}" mass="{mass:.3g}"/>'


def pendulum(rng: Generator) -> str:
    body, joint, motor = _names(rng, "rod swing drive", "arm hinge torque", "link pivot motor", "pole shaft m1")
    length, mass, bob = rng.uniform(0.3, 0.8), rng.uniform(0.2, 1.0), rng.uniform(0.0, 0.8)
    inertia = mass * length**2 / 3 + bob * length**2
    end = f'\n      <geom type="sphere" pos="0 0 {-length:.4g}" size="0.04" mass="{bob + 0.05:.3g}"/>'
    world = f"""    <body name="{body}" pos="0 0 1">
      <joint name="{joint}" axis="0 1 0"{_losses(rng, inertia)}/>
      {_rod(length, mass)}{end}
    </body>
"""
    return _wrap("pendulum", world, _motors([motor], [joint], [rng.choice([1.0, 2.5, 6.0])]), _sensors([joint]))


def cartpole(rng: Generator) -> str:
    cart, pole, slide, hinge, motor = _names(
        rng, "cart pole slider swing pusher", "wagon stick rail pivot force", "trolley load track rope winch"
    )
    mass, length, light = rng.uniform(0.6, 3.0), rng.uniform(0.3, 0.7), rng.uniform(0.1, 0.5)
    inertia = light * length**2 / 3
    world = f"""    <body name="{cart}">
      <joint name="{slide}" type="slide" axis="1 0 0"{_losses(rng, 3 * mass)}/>
      <geom type="box" size="0.1 0.06 0.04" mass="{mass:.3g}"/>
      <body name="{pole}">
        <joint name="{hinge}" axis="0 1 0"{_losses(rng, 0.3 * inertia, 0.2)}/>
        {_rod(length, light)}
      </body>
    </body>
"""
    actuators = _motors([motor], [slide], [rng.choice([1.0, 8.0, 20.0])])
    return _wrap("cartpole", world, actuators, _sensors([slide, hinge]))


def slide(rng: Generator) -> str:
    body, joint, motor = _names(rng, "carriage axis drive", "stage x linear_motor", "table feed spindle")
    mass = np.exp(rng.uniform(np.log(1.0), np.log(80.0)))
    dry = ""
    if rng.random() < 0.3:
        dry = f' frictionloss="{0.3 * mass:.3g}" solreffriction="0.002 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    world = f"""    <body name="{body}">
      <joint name="{joint}" type="slide" axis="1 0 0"{_losses(rng, 2 * mass)}{dry}/>
      <geom type="box" size="0.1 0.08 0.05" mass="{mass:.3g}"/>
    </body>
"""
    return _wrap("axis", world, _motors([motor], [joint], [rng.choice([1.0, 5.0, 30.0])]), _sensors([joint]))


def planar(rng: Generator) -> str:
    links, joints, motors = (
        _names(rng, a, b)
        for a, b in (("upper fore", "link1 link2"), ("shoulder elbow", "q1 q2"), ("m_shoulder m_elbow", "tau1 tau2"))
    )
    first, second = rng.uniform(0.25, 0.5, 2)
    mass, light = rng.uniform(0.5, 2.0), rng.uniform(0.3, 1.2)
    inertia = light * second**2 / 3
    outer = mass * first**2 / 3 + light * (first + second / 2) ** 2
    world = f"""    <body name="{links[0]}">
      <joint name="{joints[0]}" axis="0 0 1"{_losses(rng, outer)}/>
      {_rod(first, mass, "1 0 0")}
      <body name="{links[1]}" pos="{first:.4g} 0 0">
        <joint name="{joints[1]}" axis="0 0 1"{_losses(rng, inertia)}/>
        {_rod(second, light, "1 0 0")}
      </body>
    </body>
"""
    return _wrap("planar_arm", world, _motors(motors, joints, list(rng.choice([1.0, 4.0], 2))), _sensors(joints))


def double(rng: Generator) -> str:
    links, joints, motors = (
        _names(rng, a, b)
        for a, b in (("thigh shank", "inner outer"), ("hip knee", "joint_a joint_b"), ("hip_motor knee_motor", "u1 u2"))
    )
    first, second = rng.uniform(0.25, 0.5, 2)
    mass, light = rng.uniform(0.5, 2.0), rng.uniform(0.3, 1.0)
    inertia = light * second**2 / 3
    outer = mass * first**2 / 3 + light * (first + second / 2) ** 2
    world = f"""    <body name="{links[0]}" pos="0 0 1.2">
      <joint name="{joints[0]}" axis="0 1 0"{_losses(rng, 2 * outer)}/>
      {_rod(first, mass)}
      <body name="{links[1]}" pos="0 0 {-first:.4g}">
        <joint name="{joints[1]}" axis="0 1 0"{_losses(rng, 2 * inertia)}/>
        {_rod(second, light)}
      </body>
    </body>
"""
    return _wrap("leg", world, _motors(motors, joints, list(rng.choice([1.0, 3.0], 2))), _sensors(joints))


def arm3(rng: Generator) -> str:
    joints = _names(rng, "yaw shoulder elbow", "base lift bend")
    motors = _names(rng, "yaw_motor shoulder_motor elbow_motor", "act0 act1 act2")
    first, second = rng.uniform(0.2, 0.35, 2)
    mass, light = rng.uniform(0.8, 2.0), rng.uniform(0.4, 1.0)
    inertia = light * second**2 / 3
    outer = mass * first**2 / 3 + light * (first**2 + second**2 / 3)
    dry = 'solreffriction="0.002 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"' if rng.random() < 0.25 else ""
    loss = f' frictionloss="{0.6 * inertia:.3g}" {dry}' if dry else ""
    world = f"""    <body name="turret" pos="0 0 0.2">
      <joint name="{joints[0]}" axis="0 0 1"{_losses(rng, 2 * outer)}/>
      <geom type="cylinder" size="0.06 0.08" mass="{rng.uniform(0.8, 2.0):.3g}"/>
      <body name="boom" pos="0 0 0.1">
        <joint name="{joints[1]}" axis="0 1 0"{_losses(rng, 3 * outer)}/>
        {_rod(first, mass, "0.6 0 -0.8")}
        <body name="jib" pos="{0.6 * first:.4g} 0 {-0.8 * first:.4g}">
          <joint name="{joints[2]}" axis="0 1 0"{_losses(rng, 3 * inertia)}{loss}/>
          {_rod(second, light, "0.8 0 -0.6")}
        </body>
      </body>
    </body>
"""
    return _wrap("crane", world, _motors(motors, joints, [1.0, 2.0, 1.0]), _sensors(joints))


_ARM7 = (  # axis, rod, mass, inertia seen by the motor, gain of the servo
    ("0 0 1", "0 0 0.3", 3.0, 1.2, 160),
    ("0 1 0", "0 0 0.25", 2.5, 1.6, 300),
    ("0 0 1", "0.02 0 0.2", 2.0, 0.35, 60),
    ("0 -1 0", "0 0 0.2", 1.6, 0.4, 90),
    ("0 0 1", "0 0.02 0.15", 1.2, 0.06, 14),
    ("0 1 0", "0 0 0.1", 0.8, 0.05, 14),
    ("0 0 1", "0.05 0 0.06", 0.5, 0.012, 3),
)


def arm7(rng: Generator) -> str:
    """A seven-joint arm with position servos; home is upright with two bends, so that gravity loads it."""
    prefix = str(rng.choice(["joint", "a", "iiwa_"]))
    size = rng.uniform(0.85, 1.15)
    world, closing, servos, place = "", "", "", "0 0 0.1"
    joints = [f"{prefix}{number}" for number in range(1, 8)]
    for number, (axis, rod, mass, inertia, gain) in enumerate(_ARM7):
        pad = "    " + "  " * number
        rotor = f' damping="{inertia * rng.uniform(0.5, 2):.3g}" armature="{0.2 * inertia:.3g}"'
        bend = ' euler="0 0.5 0"' if number in (1, 3) else ""
        world += f'{pad}<body name="link{number + 1}" pos="{place}"{bend}>\n'
        world += f'{pad}  <joint name="{joints[number]}" axis="{axis}"{rotor}/>\n'
        world += f'{pad}  <geom type="capsule" fromto="0 0 0 {rod}" size="0.04" mass="{mass * size:.3g}"/>\n'
        closing = f"{pad}</body>\n" + closing
        place = rod
        kp, kv = gain * rng.uniform(0.8, 1.3), np.sqrt(gain * inertia) * rng.uniform(0.6, 1.2)
        servos += f'    <position name="servo{number + 1}" joint="{joints[number]}" kp="{kp:.3g}" kv="{kv:.3g}"/>\n'
    option = '><flag contact="disable"/></option'
    return _wrap("arm7", world + closing, servos, _sensors(joints)).replace("OPTIONS/>", f"OPTIONS{option}>")


def striker(rng: Generator) -> str:
    """A ram on a slide that a spring holds and that strikes a wall now and then."""
    body, joint, motor = _names(rng, "ram stroke coil", "hammer travel solenoid", "plunger axial vcm")
    mass, wall = rng.uniform(0.5, 4.0), rng.uniform(0.1, 0.16)
    soft = f"{rng.uniform(0.03, 0.06):.3g} {rng.uniform(0.2, 0.7):.3g}"
    touch = f'condim="1" solref="{soft}"'
    world = f"""    <geom name="wall" type="plane" pos="{wall + 0.05:.4g} 0 0" zaxis="-1 0 0" size="1 1 0.1" {touch}/>
    <body name="{body}">
      <joint name="{joint}" type="slide" axis="1 0 0"{_losses(rng, 2 * mass)} stiffness="{mass * 36:.3g}"/>
      <geom type="sphere" size="0.05" mass="{mass:.3g}" {touch}/>
    </body>
"""
    return _wrap("striker", world, _motors([motor], [joint], [rng.choice([1.0, 10.0])]), _sensors([joint]))


SYSTEMS = {
    system.name: system
    for system in (
        System("pendulum", pendulum),
        System("cartpole", cartpole),
        System("slide", slide, acceleration=(15.0, 4.0)),
        System("planar", planar, acceleration=(12.0, 3.0)),
        System("double", double, acceleration=(12.0, 3.0)),
        System("arm3", arm3, acceleration=(10.0, 3.0)),
        System("arm7", arm7, servo=True, closed=False, spread=0.3),
        System("striker", striker, acceleration=(15.0, 6.0), closed=False, spread=0.1),
    )
}

STEPS = {50: (0.001, 0.002, 0.005), 100: (0.001, 0.002, 0.005), 200: (0.001, 0.005), 250: (0.001, 0.002)}
"""Time steps of the model that divide the recording's own, by its rate."""


def write_model(system: System, rate: int, rng: Generator, need_rotor: bool = False) -> str:
    """MJCF text with options as users set them; with a rotor inertia on each joint if the effect needs one."""
    step = rng.choice(STEPS.get(rate, (0.001, 0.002)))
    integrator = rng.choice(["Euler", "implicitfast", "RK4"])
    for _ in range(100):
        text = system.write(rng)
        if not need_rotor or text.count("armature=") == text.count("<joint "):
            break
    if "frictionloss" in text or system.name == "striker":  # what is stiff asks for a small step
        step = 0.001
    return text.replace("OPTIONS", f'timestep="{step:g}" integrator="{integrator}"')
