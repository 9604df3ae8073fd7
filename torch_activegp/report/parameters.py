"""Parameters of the laws, with units and intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from torch_activegp.report.numbers import MISSING, estimate, is_number, percent
from torch_activegp.report.section import Section, Values
from torch_activegp.report.words import capital, counted, effect_text


def parameters(diagnosis: Values, evidence: Values) -> Section | None:
    """One row for each number of each named effect, and of what was fitted along; None if there is none."""
    effects = [_group(effect) for effect in diagnosis.get("effects") or []]
    retuned = [_group(effect) for effect in diagnosis.get("retuned") or []]
    effects, retuned = ([group for group in groups if group["rows"]] for groups in (effects, retuned))
    if not (effects or retuned):
        return None
    rows = [row for group in effects for row in group["rows"]]
    loose = [row for row in rows if row["loose"]]
    count = counted(len(rows) or sum(len(group["rows"]) for group in retuned), "parameter")
    if not rows:
        heading = f"{count} fitted along"
    elif all(row["interval"] == MISSING for row in rows):
        heading = f"{count} fitted"
    elif loose:
        heading = f"{count} fitted; {len(loose)} could as well be zero"
    else:
        heading = f"{count} fitted, with {'its 95 % interval' if len(rows) == 1 else 'their 95 % intervals'}"
    return Section("parameters", "Parameters", heading, {"effects": effects, "retuned": retuned})


def _group(effect: Values) -> dict[str, Any]:
    rows = [row for name, found in (effect.get("parameters") or {}).items() for row in _rows(name, found)]
    probability = effect.get("probability")
    return {
        "name": capital(effect_text(effect)),
        "law": effect.get("law") or "",
        "probability": percent(probability) if is_number(probability) else "",
        "rows": rows,
    }


def _rows(name: str, found: Values) -> list[dict[str, Any]]:
    value, interval = found.get("value"), found.get("ci95")
    if not isinstance(value, Sequence) or isinstance(value, str):
        return [_row(name, value, interval, found.get("unit"))]
    nested = interval if interval is not None and len(interval) == len(value) else [None] * len(value)
    pairs = zip(value, nested, strict=True)
    return [_row(f"{name} {index}", part, ends, found.get("unit")) for index, (part, ends) in enumerate(pairs, 1)]


def _row(name: str, value: Any, interval: Any, unit: str | None) -> dict[str, Any]:
    text, ends = estimate(value, interval)
    picture = _picture(value, interval) if ends != MISSING else None
    return {
        "name": name.replace("_", " "),
        "value": text,
        "interval": ends,
        "unit": unit or "",
        "picture": picture,
        "loose": picture is not None and interval[0] < 0 < interval[1],
    }


def _picture(value: Any, interval: Sequence[Any]) -> dict[str, float] | None:
    """Places in per cent of zero, the value and the interval's ends on one short axis."""
    numbers = (0.0, value, *interval)
    if not all(is_number(item) and math.isfinite(item) for item in numbers):
        return None
    low, high = min(numbers), max(numbers)
    if high == low:
        return None
    at = [round(4 + 92 * (item - low) / (high - low), 1) for item in numbers]
    return {"zero": at[0], "value": at[1], "start": at[2], "width": round(at[3] - at[2], 1)}
