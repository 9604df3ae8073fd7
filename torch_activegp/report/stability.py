"""Whether names and parameters stand when each recording is left out in turn."""

from __future__ import annotations

from typing import Any

from torch_activegp.report.numbers import estimate, is_number, number, unit_text
from torch_activegp.report.section import Section, Values
from torch_activegp.report.words import capital, effect_text, listed


def stability(diagnosis: Values, evidence: Values) -> Section | None:
    """One row for each parameter of each named effect; None where nothing was left out."""
    found = diagnosis.get("stability")
    if not found:
        return None
    units = {
        (effect["name"], effect.get("target"), name): unit_text(parameter.get("unit"))
        for effect in diagnosis.get("effects") or []
        for name, parameter in (effect.get("parameters") or {}).items()
    }
    groups = [_group(effect, units) for effect in found["effects"]]
    resting = [group for group in groups if group["rests"]]
    if resting:
        heading = f"Not every recording shows it: {listed(group['name'] for group in resting)}"
    elif found.get("sound"):
        heading = "Stands whichever recording is left out"
    else:
        heading = "Changes with the recording that is left out"
    return Section("stability", "Stability", heading, {"groups": groups, "sentence": found.get("sentence") or ""})


def _group(effect: Values, units: dict[Any, str]) -> dict[str, Any]:
    gains = effect.get("gains") or []
    better = sum(is_number(gain) and gain > 0.0 for gain in gains) + len(effect.get("fails_without") or [])
    return {
        "name": capital(effect_text(effect)),
        "forecasts": f"forecasts {better} of {len(gains)} better" if gains else "",
        "rests": f"rests on {listed(effect.get('rests_on') or [])}" if effect.get("rests_on") else "",
        "rows": [
            _row(name, spread, units.get((effect["name"], effect.get("target"), name), ""))
            for name, spread in (effect.get("parameters") or {}).items()
        ],
    }


def _row(name: str, spread: Values, unit: str) -> dict[str, Any]:
    low, high = spread.get("low"), spread.get("high")
    middle = (low + high) / 2 if is_number(low) and is_number(high) else None
    text = number(low) if low == high else estimate(middle, (low, high))[1]
    return {
        "name": name.replace("_", " "),
        "range": text,
        "unit": unit,
        "shift": number(spread.get("shift"), 2),
        "farthest": spread.get("farthest") or "",
    }
