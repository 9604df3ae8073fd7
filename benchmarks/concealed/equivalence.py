"""Names that physics itself cannot tell apart, whatever is recorded.

| the effect | is also | where | because |
|---|---|---|---|
| constant_force on a joint | actuator_bias on its only motor | everywhere | the gain is constant |
| constant_force on a joint | gravity_error | one slide alone | a tilted axis |
| constant_force, actuator_bias | sensor_bias | one joint with a spring and no weight | the spring's rest moves |
| sensor_bias on the first joint | gravity_error | chains of parallel hinges in gravity | the whole machine is turned |
| actuator_delay | sensor_delay | one joint, one motor | the machine does not change with time |
| actuator_gain | sensor_gain | one linear slide | y = s q obeys m y'' = s g u - c y' |
| payload_mass, armature_error, center_of_mass_offset | each other | first body, slide or flat arm | one inertia |

And sets: asymmetric dry friction is Coulomb friction and a constant force; a spring's rest is a constant force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Entry = tuple[str, str]
HANGING = ("pendulum", "double")
FLAT = ("slide", "cartpole", "planar", "striker")
"""Machines whose first body feels no weight along its joint."""


def _groups(key: Mapping[str, Any]) -> list[set[Entry]]:
    machine = key["machine"]
    system, joints, motors = key["system"], machine["joints"], machine["motors"]
    first, body = joints[0], machine["bodies"][0]
    groups: list[set[Entry]] = []
    for motor, joint in motors.items():
        groups.append({("constant_force", f"joint:{joint}"), ("actuator_bias", f"actuator:{motor}")})
        if len(joints) == 1:
            groups.append({("actuator_delay", f"actuator:{motor}"), ("sensor_delay", f"sensor:{first}")})
        if system == "slide":
            groups.append({("actuator_gain", f"actuator:{motor}"), ("sensor_gain", f"sensor:{first}")})
        if system in ("slide", "striker"):
            groups[0].add(("gravity_error", "world"))
        if system == "striker":
            groups[0].add(("sensor_bias", f"sensor:{first}"))
    if system in HANGING:
        groups.append({("sensor_bias", f"sensor:{first}"), ("gravity_error", "world")})
    if system in FLAT:
        inertia = {("payload_mass", f"body:{body}"), ("armature_error", f"joint:{first}")}
        groups.append(inertia | ({("center_of_mass_offset", f"body:{body}")} if system == "planar" else set()))
    return groups


def equals(entry: Entry, key: Mapping[str, Any]) -> set[Entry]:
    """All names and targets that are the same physics as this one on this machine, itself among them."""
    found = {entry}
    for group in _groups(key):
        if entry in group:
            found |= group
    return found


def partners(effects: Sequence[Mapping[str, Any]], key: Mapping[str, Any]) -> set[Entry]:
    """What may be named beside the true effects because it is a part of one of them."""
    found: set[Entry] = set()
    for effect in effects:
        target = effect["target"]
        if effect["name"] == "asymmetric_friction":
            found |= equals(("constant_force", target), key)
            dry = "positive_level" in effect["parameters"]
            found.add(("coulomb_friction" if dry else "viscous_friction", target))
        if effect["name"] == "linear_spring":
            found |= equals(("constant_force", target), key)
    return found


def decomposed(effect: Mapping[str, Any], key: Mapping[str, Any]) -> list[set[Entry]] | None:
    """The two entries that together are asymmetric dry friction, each as the set of its equals."""
    if effect["name"] != "asymmetric_friction" or "positive_level" not in effect["parameters"]:
        return None
    target = effect["target"]
    return [{("coulomb_friction", target)}, equals(("constant_force", target), key)]


_SIBLINGS = (
    {"viscous_friction", "asymmetric_friction"},
    {"coulomb_friction", "asymmetric_friction", "stribeck_friction", "hysteresis"},
    {"linear_spring", "constant_force"},
    {"actuator_delay", "actuator_lag"},
)


def overlap(effects: Sequence[Entry], key: Mapping[str, Any]) -> bool:
    """Whether two effects of a case are the same or contain one another, so that a set of both means nothing."""
    for place, one in enumerate(effects):
        for other in effects[place + 1 :]:
            siblings = any({one[0], other[0]} <= group for group in _SIBLINGS) and one[1] == other[1]
            if siblings or other in equals(one, key):
                return True
    return False
