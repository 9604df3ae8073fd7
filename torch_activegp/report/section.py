"""What every section of the report is made of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

Values = Mapping[str, Any]


@dataclass(frozen=True)
class Section:
    """One section.

    Args:
        name: its anchor, and the name of its template.
        label: its entry in the table of contents.
        heading: the finding.
        content: what its template shows.
    """

    name: str
    label: str
    heading: str
    content: Mapping[str, Any] = field(default_factory=dict)


def units(evidence: Values) -> dict[str, str]:
    """Units of channels, as far as the evidence names them: ``{"qvel.elbow": "rad/s"}``."""
    found = {trace["channel"]: trace.get("unit") or "" for trace in evidence.get("traces") or []}
    found |= {law["over"]: law.get("unit_x") or "" for law in evidence.get("laws") or []}
    for name, unit in list(found.items()):
        kind, _, joint = name.partition(".")
        if kind == "qpos" and unit:
            found.setdefault(f"qvel.{joint}", f"{unit}/s")
        if kind == "qvel" and unit.endswith("/s"):
            found.setdefault(f"qpos.{joint}", unit.removesuffix("/s"))
    return found


def with_unit(channel: str, known: Mapping[str, str]) -> str:
    """An axis label: ``qvel.elbow [rad/s]``."""
    unit = "s" if channel == "time" else known.get(channel, "")
    return f"{channel} [{unit}]" if unit else channel
