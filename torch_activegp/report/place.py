"""The map of the mismatch: which part of the machine, when, and where in its motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torch_activegp.report.axis import Axis, axis_over
from torch_activegp.report.chart import Chart, level, steps
from torch_activegp.report.numbers import is_number, minus, number, p_value, percent
from torch_activegp.report.section import Section, Values, units, with_unit
from torch_activegp.report.strip import cells, legend, spans
from torch_activegp.report.words import capital, place_name

_MOST_RUNS = 24
_MOST_CHARTS = 24
_SIGNIFICANT = 0.05
_WHOLE = 1.005
_QUIET = 0.5
_ALL_BUT = 0.02
"""Part of a range that may lie to either side of what is called everywhere."""


def place(diagnosis: Values, evidence: Values) -> Section | None:
    """Where and when the simulator is wrong; None without any map."""
    known = units(evidence)
    looks = ("before", "after") if diagnosis.get("effects") else ("before",)  # else nothing was corrected
    maps = [found for found in evidence.get("map_region") or [] if len(found.get("before") or [])]
    seen = {found["over"]: (found["edges"][0], found["edges"][-1]) for found in maps}
    rows = [_row(found, known, seen) for found in diagnosis.get("location") or []]
    maps.sort(key=_peak, reverse=True)
    times = _times(evidence, looks)
    if not (rows or maps or times):
        return None
    content = {
        "rows": rows,
        "overlap": sum(found.get("share") or 0.0 for found in diagnosis.get("location") or []) > _WHOLE,
        "times": times,
        "legend": legend(),
        "charts": _charts(maps[:_MOST_CHARTS], looks, known),
    }
    return Section("place", "Where", _heading(diagnosis), content)


def _heading(diagnosis: Values) -> str:
    found = diagnosis.get("location") or []
    if diagnosis["verdict"] == "none":
        return "No part of the motion stands out from the noise"
    if not found:
        return "Where and when the simulator is wrong"
    first = max(found, key=lambda item: item.get("share") or 0.0)
    share = first.get("share")
    if not is_number(share) or _is_weak(first):
        return f"The mismatch sits at {place_name(first['target'])}"
    return f"{capital(place_name(first['target']))} carries {percent(share)} of the mismatch"


def _row(found: Values, known: Values, seen: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """One part of the machine; ranges that hold all that was recorded are no ranges."""
    region = {name: ends for name, ends in (found.get("region") or {}).items() if not _holds(ends, seen.get(name))}
    significant = found.get("q_value")
    return {
        "target": place_name(found["target"]),
        "share": percent(found.get("share")),
        "width": round(100 * min(1.0, max(0.0, found.get("share") or 0.0)), 1),
        "region": "; ".join(_range(name, ends, known) for name, ends in region.items()) or "everywhere",
        "q": p_value(significant).replace("p", "q", 1) if is_number(significant) else "",
        "weak": _is_weak(found),
    }


def _is_weak(found: Values) -> bool:
    """Whether no bins of forces show it: a named effect alone says where it is."""
    significant = found.get("q_value")
    return is_number(significant) and significant > _SIGNIFICANT


def _holds(ends: Any, seen: tuple[float, float] | None) -> bool:
    """Whether a range holds, but for its edges, all that was seen."""
    if seen is None or not all(is_number(end) for end in (*ends, *seen)):
        return False
    slack = _ALL_BUT * (seen[1] - seen[0])
    return bool(ends[0] <= seen[0] + slack and ends[1] >= seen[1] - slack)


def _range(name: str, ends: Any, known: Values) -> str:
    unit = "s" if name == "time" else known.get(name, "")
    return f"{name} {number(ends[0])} to {number(ends[1])} {unit}".rstrip()


def _times(evidence: Values, looks: Sequence[str]) -> dict[str, Any] | None:
    runs = [run for run in evidence.get("map_time") or [] if len(run.get("time") or [])]
    if not runs:
        return None
    chosen = sorted(runs, key=_peak, reverse=True)[:_MOST_RUNS]
    shown = [run for run in runs if any(run is other for other in chosen)]
    ends = [_ends(run) for run in shown]
    axis = Axis("time [s]", min(0.0, *(low for low, _ in ends)), max(high for _, high in ends), wanted=8)
    strips = [
        {"run": run["run"], "look": look, "cells": cells(axis, run["time"], run[look], run.get("seconds"))}
        for run in shown
        for look in looks
        if len(run.get(look) or [])
    ]
    left_out = f"The {len(shown)} worst of {len(runs)} runs." if len(shown) < len(runs) else ""
    return {"axis": axis, "strips": strips, "both": len(looks) > 1, "left_out": left_out}


def _ends(run: Values) -> tuple[float, float]:
    lengths = run.get("seconds")
    left, right = spans(np.asarray(run["time"], dtype=float), None if lengths is None else np.asarray(lengths))
    return float(left[0]), float(right[-1])


def _peak(found: Values) -> float:
    values = np.asarray(found["before"], dtype=float)
    return float(np.nanmax(values)) if np.isfinite(values).any() else 0.0


def _charts(maps: list[Values], looks: Sequence[str], known: Values) -> list[Chart]:
    heights = [_shown(found.get(key) or []) for found in maps for key in looks]
    y = axis_over("(mean residual force / its standard error)\u00b2", [_QUIET, 4.0], *heights, log=True)
    return [_chart(found, y, looks, known) for found in maps]


def _shown(squares: Any) -> NDArray[np.float64]:
    """Squares as they are drawn: in a bin where little is left, how near its mean comes to zero is an accident."""
    return np.maximum(np.asarray(squares, dtype=np.float64).ravel(), _QUIET)


def _chart(found: Values, y: Axis, looks: Sequence[str], known: Values) -> Chart:
    edges, before = np.asarray(found["edges"], dtype=float), np.asarray(found["before"], dtype=float)
    count = np.asarray(found.get("count") or np.ones_like(before), dtype=float)
    before = np.where(count > 0, before, np.nan)
    x = axis_over(with_unit(found["over"], known), edges, margin=0.0)
    marks = [level("noise-level", y, 1.0, "noise")]
    for look in looks:
        if len(found.get(look) or []):
            marks.append(steps(look, x, y, (edges, np.where(count > 0, _shown(found[look]), np.nan)), look))
    title = f"{capital(place_name(found['channel']))} over {found['over']}"
    if np.isfinite(before).any():
        worst = int(np.nanargmax(before))
        middle = minus(number((edges[worst] + edges[worst + 1]) / 2, 2))
        title += f": worst near {middle}, {number(float(np.sqrt(before[worst])), 2)} standard errors"
    return Chart(title, x, y, marks)
