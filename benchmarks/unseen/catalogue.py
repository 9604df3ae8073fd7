"""Which case is of which kind, on which machine, with which effects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Spec:
    """One case: effects are (name, target)."""

    kind: str
    machine: str
    effects: tuple[tuple[str, str], ...]


def _spec(kind: str, line: str) -> Spec:
    machine, *effects = line.split()
    pairs = [tuple(e.split("@")) for e in effects]
    return Spec(kind, machine, tuple((name, where) for name, where in pairs))


_LINES = {
    "control": """
        antenna; finger; excavator; valve; hexleg; lift; reaction; hip; gimbal; arm7; wheelleg; polar; trolley; door""",
    "weak": """
        antenna coulomb_friction@joint:elevation; finger payload_mass@body:distal; door linear_spring@joint:hinge;
        hexleg coulomb_friction@joint:femur; excavator viscous_friction@joint:stick;
        reaction actuator_delay@actuator:motor; hip viscous_friction@joint:knee; gimbal cogging@joint:roll;
        arm7 payload_mass@body:link7; polar armature_error@joint:tilt; trolley quadratic_drag@joint:trolley;
        wheelleg cubic_spring@joint:slide""",
    "single": """
        antenna backlash@joint:azimuth; antenna sensor_gain@sensor:elevation; finger actuator_lag@actuator:s_mcp;
        excavator asymmetric_friction@joint:stick; excavator center_of_mass_offset@body:bucket;
        valve joint_stop@joint:stem; hexleg hysteresis@joint:tibia; lift actuator_dead_zone@actuator:flip_motor;
        reaction stribeck_friction@joint:pivot; hip actuator_saturation@actuator:hip_motor;
        gimbal actuator_delay@actuator:m_pitch; arm7 coulomb_friction@joint:j4; wheelleg quadratic_drag@joint:axle;
        polar payload_mass@body:carriage; polar sensor_bias@sensor:tilt; trolley gravity_error@world;
        door viscous_friction@joint:hinge""",
    "two": """
        antenna coulomb_friction@joint:azimuth actuator_gain@actuator:el_motor;
        finger linear_spring@joint:dip coulomb_friction@joint:mcp;
        excavator payload_mass@body:bucket viscous_friction@joint:boom;
        valve cogging@joint:stem actuator_delay@actuator:motor;
        reaction viscous_friction@joint:pivot cogging@joint:wheel;
        gimbal coulomb_friction@joint:yaw cubic_spring@joint:roll;
        arm7 armature_error@joint:j5 constant_force@joint:j2;
        polar sensor_delay@sensor:reach coulomb_friction@joint:tilt;
        trolley coulomb_friction@joint:trolley payload_mass@body:load;
        wheelleg joint_stop@joint:slide actuator_gain@actuator:hub""",
    "three": """
        hip coulomb_friction@joint:knee linear_spring@joint:hip actuator_gain@actuator:hip_motor;
        excavator coulomb_friction@joint:boom linear_spring@joint:bucket actuator_lag@actuator:stick_cyl;
        hexleg coulomb_friction@joint:tibia payload_mass@body:tibia viscous_friction@joint:coxa;
        lift cogging@joint:flip viscous_friction@joint:lift actuator_bias@actuator:flip_motor""",
    "retuned": """
        antenna stribeck_friction@joint:azimuth; finger coulomb_friction@joint:pip;
        excavator quadratic_drag@joint:boom; valve cubic_spring@joint:stem; hexleg payload_mass@body:tibia;
        lift payload_mass@body:head; reaction coulomb_friction@joint:pivot actuator_dead_zone@actuator:motor;
        hip center_of_mass_offset@body:shank coulomb_friction@joint:hip; gimbal hysteresis@joint:pitch;
        polar actuator_lag@actuator:reach_motor coulomb_friction@joint:base; trolley coulomb_friction@joint:trolley;
        door asymmetric_friction@joint:hinge""",
    "outside": """
        antenna periodic_disturbance@joint:azimuth; finger coupling_spring@joint:pip;
        hip second_order_drive@actuator:hip_motor; wheelleg torque_ripple@actuator:hub;
        gimbal friction_pattern@joint:yaw; trolley thermal_gain@actuator:winch""",
}
SPECS: tuple[Spec, ...] = tuple(
    _spec(kind, " ".join(line.split())) for kind, text in _LINES.items() for line in text.split(";")
)


def order(seed: int) -> list[int]:
    """A shuffle in which the first n cases are a fair sample of the kinds."""
    rng = np.random.default_rng([seed, 1])
    place: list[tuple[float, int]] = []
    for kind in _LINES:
        mine = [i for i, s in enumerate(SPECS) if s.kind == kind]
        shift = rng.random()
        place += [((rank + shift) / len(mine), int(i)) for rank, i in enumerate(rng.permutation(mine))]
    return [i for _, i in sorted(place)]
