"""Held-out runs before and after the correction, and how the errors compare with the noise."""

from __future__ import annotations

from typing import Any

import numpy as np

from torch_activegp.report.axis import Axis, axis_over
from torch_activegp.report.chart import Chart, band, line
from torch_activegp.report.numbers import is_number, number, percent, quantity
from torch_activegp.report.section import Section, Values
from torch_activegp.report.words import telling

_FIRST = 3
_MOST = 24
_MARGIN = 0.3
_WINDOWS = 60
_SHORTEST = 5
_TWO_SIDED_95 = 1.96
_AT, _NEAR = 1.1, 3.0
"""Errors up to so many times the noise are the noise; up to so many are told in units of it."""
_TEXTS = {"before": "simulator", "after": "corrected", "gp": "corrected + GP"}
_KINDS = (("free_run", "Free run"), ("one_step", "One step"))


def traces(diagnosis: Values, evidence: Values) -> Section | None:
    """Traces and errors of the held-out runs; None if there are neither."""
    found = [trace for trace in evidence.get("traces") or [] if len(trace.get("time") or [])]
    holdout = ((diagnosis.get("fit") or {}).get("holdout")) or {}
    rows = [row for run in holdout.get("runs") or [] for row in _rows(run)]
    total = _rows({"run": "all", "channel": "all", **holdout})
    if not (found or rows or total):
        return None
    pairs = [_charts(trace) for trace in found[:_MOST]]
    content = {
        "pairs": pairs[:_FIRST],
        "more": pairs[_FIRST:],
        "left_out": len(found) - len(pairs),
        "rows": rows or total,
        "corrected": bool(diagnosis.get("effects")),
        "gp": any(row["gp"] for row in rows or total),
    }
    return Section("traces", "Held-out runs", _heading(diagnosis, holdout), content)


def _heading(diagnosis: Values, holdout: Values) -> str:
    kind = telling(holdout)
    error, what = holdout.get(kind) or {}, "the error" if kind == "free_run" else "the error by one step"
    before, after, noise = (error.get(key) for key in ("before", "after", "noise"))
    if diagnosis["verdict"] == "none" and is_number(before):
        return f"On runs that it never saw, the simulator is off by {percent(before)} of the motion"
    if not (is_number(before) and is_number(after)):
        return "Forecasts of runs that the fit never saw"
    if is_number(learned := error.get("gp")) and learned < after:
        step = "" if after >= before else f" to {percent(after)}, and with a learned force"
        verb = "falls" if step else "falls with a learned force"
        return f"On runs that the fit never saw, {what} {verb} from {percent(before)}{step} to {percent(learned)}"
    verb = "falls" if after < before else "goes"
    if is_number(noise) and noise > 0.0 and after <= _NEAR * noise:
        level = "the noise" if after <= _AT * noise else f"{number(after / noise, 2)} times the noise"
        return f"On runs that the fit never saw, {what} {verb} from {percent(before)} to {level}, {percent(after)}"
    return f"On runs that the fit never saw, {what} {verb} from {percent(before)} to {percent(after)}"


def _rows(run: Values) -> list[dict[str, Any]]:
    return [
        {
            "run": run.get("run"),
            "channel": run.get("channel"),
            "kind": label,
            **{name: percent(run[key].get(name)) for name in ("before", "after", "noise")},
            "gp": percent(run[key]["gp"]) if is_number(run[key].get("gp")) else "",
        }
        for key, label in _KINDS
        if run.get(key)
    ]


def _charts(trace: Values) -> tuple[Chart, Chart]:
    """The trace itself, and beneath it the errors with the noise band."""
    unit, noise = trace.get("unit") or "", trace.get("noise")
    time, measured = (np.asarray(trace[key], dtype=float) for key in ("time", "measured"))
    lines = {key: np.asarray(trace[key], dtype=float) for key in ("before", "after", "gp") if len(trace.get(key) or [])}
    if "after" in lines and "before" in lines and np.array_equal(lines["before"], lines["after"], equal_nan=True):
        del lines["after"]  # nothing was corrected
    x = axis_over("time [s]", time, margin=0.0)
    y = axis_over(_label(trace["channel"], unit), measured, margin=_MARGIN)
    marks = [line("measured", x, y, (time, measured), "measured")]
    marks += [line(key, x, y, (time, values), _TEXTS[key]) for key, values in lines.items()]
    with np.errstate(invalid="ignore"):  # a model that ran away
        errors = {key: values - measured for key, values in lines.items()}
    return Chart(_title(trace, errors), x, y, marks), _error_chart(time, errors, x, (noise, unit))


def _error_chart(time: np.ndarray, errors: dict[str, np.ndarray], x: Axis, noise_in_unit: tuple[Any, str]) -> Chart:
    """Errors of all models in short windows, logarithmic, over the band in which noise alone would lie."""
    noise, unit = noise_in_unit
    length = max(_SHORTEST, len(time) // _WINDOWS)
    pieces = np.array_split(np.arange(len(time)), max(1, len(time) // length))
    sizes = {key: [_rms(values[piece]) for piece in pieces] for key, values in errors.items()}
    spread = _TWO_SIDED_95 / np.sqrt(2 * length)  # of the rms of white noise
    ends = (noise * max(1 - spread, 0.1), noise * (1 + spread)) if is_number(noise) and 0 < noise < np.inf else None
    y = axis_over(_label("rms error", unit), *sizes.values(), [0.6 * noise] if ends else [], log=True, margin=0.08)
    marks = [band("noise", y, ends, f"noise alone, {quantity(noise, unit)}")] if ends else []
    centres = [float(np.mean(time[piece])) for piece in pieces]
    marks += [line(key, x, y, (centres, values), _TEXTS[key]) for key, values in sizes.items()]
    seconds = quantity(float(time[-1] - time[0]) / len(pieces), "s")
    return Chart(f"Error in windows of {seconds} against the noise", x, y, marks, size="low")


def _label(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _title(trace: Values, errors: dict[str, np.ndarray]) -> str:
    unit = trace.get("unit") or ""
    where = f"{trace['channel']} in {trace['run']}"
    sizes = " \u2192 ".join(quantity(_rms(errors[key]), unit) for key in ("before", "after") if key in errors)
    noise = f", noise {quantity(trace['noise'], unit)}" if is_number(trace.get("noise")) else ""
    return f"{where}: rms error {sizes}{noise}" if sizes else where


def _rms(values: np.ndarray) -> float:
    known = values[~np.isnan(values)]
    with np.errstate(over="ignore"):
        return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
