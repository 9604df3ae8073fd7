"""Answers that are as good as the truth, listed: no recording of positions and controls tells them apart."""

from __future__ import annotations

from collections.abc import Iterator

from benchmarks.unseen.machine import Machine

Atom = tuple[str, str]
Names = frozenset[Atom]


def normal(machine: Machine, name: str, target: str) -> Atom:
    """One spelling: a sensor by its joint, play by the joint of its motor."""
    kind, _, where = target.partition(":")
    where = where.removeprefix("qpos.")
    if name.startswith("sensor_"):
        return name, f"joint:{where}"
    if name in ("backlash", "hysteresis") and kind == "actuator":
        return name, f"joint:{machine.motors[machine.motor(where)].joint}"
    return name, target


def _swaps(machine: Machine) -> list[tuple[Names, Names]]:
    """Pairs of sets that mean the same."""
    pairs: list[tuple[Names, Names]] = []
    for motor in machine.motors:  # a constant force, and an offset of the motor that makes it
        pairs.append((frozenset({("constant_force", f"joint:{motor.joint}")}),
                      frozenset({("actuator_bias", f"actuator:{motor.name}")})))  # fmt: skip
    for joint in machine.joints:  # dry friction of two levels, and of one with a constant push
        at = f"joint:{joint.name}"
        pairs.append((frozenset({("asymmetric_friction", at)}),
                      frozenset({("coulomb_friction", at), ("constant_force", at)})))  # fmt: skip
    for group in machine.same:  # declared by the machine
        atoms = [normal(machine, *a) for a in group]
        pairs += [(frozenset({a}), frozenset({b})) for i, a in enumerate(atoms) for b in atoms[i + 1 :] if a != b]
    return pairs


def _neighbours(machine: Machine, names: Names) -> Iterator[Names]:
    for a, b in _swaps(machine):
        if a <= names:
            yield (names - a) | b
        if b <= names:
            yield (names - b) | a


def equivalents(machine: Machine, names: Names) -> set[Names]:
    """The truth and all that equals it."""
    found, fresh = {names}, [names]
    while fresh:
        for other in _neighbours(machine, fresh.pop()):
            if other not in found:
                found.add(other)
                fresh.append(other)
    return found


def corrections(machine: Machine, retuned: list[str]) -> Names:
    """What may be named beside the truth, because the lab's tuning has put it wrong."""
    found: set[Atom] = set()
    for key in retuned:
        kind, _, name = key.partition("_")
        if kind == "damping":
            found.add(("viscous_friction", f"joint:{name}"))
        if kind == "armature":
            found.add(("armature_error", f"joint:{name}"))
        if kind in ("gain", "gear", "kp"):
            found.add(("actuator_gain", f"actuator:{name}"))
        joint = machine.motors[machine.motor(name)].joint if kind in ("kp", "bias") else ""
        if kind == "kp":
            found.add(("linear_spring", f"joint:{joint}"))
        if kind == "bias":
            found |= {("actuator_bias", f"actuator:{name}"), ("constant_force", f"joint:{joint}")}
    return frozenset(found)
