"""Was the effect put where it is: by the map of the mismatch, and by the target of what was named?"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchmarks.concealed.equivalence import Entry, equals


def normal(name: str, target: str) -> Entry:
    """A name and its target, where a sensor may go by its own name, its channel or its joint."""
    kind, _, rest = target.partition(":")
    if kind == "sensor":
        rest = rest.removeprefix("qpos.").removesuffix("_encoder")
    return name, f"{kind}:{rest}" if rest else kind


def joints_of(target: str, key: Mapping[str, Any]) -> set[str]:
    """Joints where an effect on this target can show: a body loads all joints that carry it."""
    machine = key["machine"]
    kind, _, name = target.partition(":")
    if kind == "actuator":
        return {machine["motors"].get(name, "?")}
    if kind == "body":
        return set(machine["joints"][: machine["bodies"].index(name) + 1]) if name in machine["bodies"] else set()
    if kind == "world":
        return set(machine["joints"])
    return {normal("", target)[1].partition(":")[2]}


def places(key: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> list[dict[str, Any]]:
    """For each truth with a place: its kind, whether the first places of the map and any named target hold it.

    As many first places count as there are truths. Without a detected mismatch both are wrong; gravity has no place.
    """
    truths = [normal(effect["name"], effect["target"]) for effect in key["effects"]]
    mapped = [place["target"] for place in diagnosis.get("location") or []][: len(truths)]
    joints = set().union(*(joints_of(place, key) for place in mapped), set())
    said = {normal("", effect["target"])[1] for effect in diagnosis.get("effects") or []}
    rows = []
    for name, target in truths:
        if target == "world":
            continue
        same = {target} | ({other for _, other in equals((name, target), key)} if key["kind"] != "outside" else set())
        located, hit = bool(joints_of(target, key) & joints), bool(same & said)
        rows.append({"kind": target.partition(":")[0], "located": located, "named": hit})
    return rows
