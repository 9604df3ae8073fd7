"""Parameters of the laws, with units and intervals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from torch_activegp.report.numbers import MISSING, estimate, is_number, percent, unit_text
from torch_activegp.report.reading import holds_nothing, nothing, where
from torch_activegp.report.section import Section, Values
from torch_activegp.report.words import capital, counted, effect_text, listed

_NOTHING = {0.0: "zero", 1.0: "one"}


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
        heading = f"{count} fitted; {len(loose)} could as well be {_nothings(loose)}"
    else:
        heading = f"{count} fitted, with {'its 95 % interval' if len(rows) == 1 else 'their 95 % intervals'}"
    content = {"effects": effects, "retuned": retuned, "origins": [_origins(effects), _origins(retuned)]}
    return Section("parameters", "Parameters", heading, content)


def _group(effect: Values) -> dict[str, Any]:
    known = (effect.get("parameters") or {}).items()
    rows = [_row(effect["name"], name, found) for name, found in known]
    probability = effect.get("probability")
    return {
        "name": capital(effect_text(effect)),
        "law": effect.get("law") or "",
        "probability": percent(probability) if is_number(probability) else "",
        "excess": bool(effect.get("too_much")),
        "rows": rows,
    }


def _row(effect: str, name: str, found: Values) -> dict[str, Any]:
    value, interval = found.get("value"), found.get("ci95")
    text, ends = estimate(value, interval)
    origin = nothing(effect, name)
    picture = _picture(origin, value, interval) if interval is not None and ends != MISSING else None
    return {
        "name": name.replace("_", " "),
        "where": where(effect, name, value),
        "nothing": _NOTHING[origin],
        "value": text,
        "interval": ends,
        "unit": unit_text(found.get("unit")),
        "picture": picture,
        "loose": picture is not None and holds_nothing(effect, name, interval),
    }


def _origins(groups: Sequence[Values]) -> str:
    """The heading of the pictures: where they begin."""
    return f"From {_nothings([row for group in groups for row in group['rows']])}"


def _nothings(rows: Sequence[Values]) -> str:
    """The values with which nothing is wrong: zero, one, or both in words."""
    return listed(sorted({row["nothing"] for row in rows}, reverse=True), "or")


def _picture(origin: float, value: Any, interval: Sequence[Any]) -> dict[str, float] | None:
    """Places in per cent of the value that means nothing, the value and the interval's ends on one short axis."""
    numbers = (origin, value, *interval)
    if not all(is_number(item) and math.isfinite(item) for item in numbers):
        return None
    low, high = min(numbers), max(numbers)
    if high == low:
        return None
    at = [round(4 + 92 * (item - low) / (high - low), 1) for item in numbers]
    return {"origin": at[0], "value": at[1], "start": at[2], "width": round(at[3] - at[2], 1)}
