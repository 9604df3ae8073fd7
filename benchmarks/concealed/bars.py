"""The figures that the proof is about, each a rate with its exact interval or a median."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

Row = Mapping[str, Any]
Line = tuple[str, str]

BANDS = {"chi2/dof >= 1.3": (1.3, np.inf), "chi2/dof 1.05-1.3": (1.05, 1.3), "chi2/dof < 1.05": (0.0, 1.05)}
"""Detectability: chi2 per degree of freedom of the nominal."""

NOISES = {"noise up to 0.5 mrad": (0.0, 0.5), "noise 0.5-1.6 mrad": (0.5, 1.6), "noise 1.6-5 mrad": (1.6, np.inf)}
"""Of the noisiest channel; 0.3 mm on a slide stand for 1 mrad."""

HALF = 0.5


def rate(hits: int, total: int) -> str:
    """A share with its exact 95 % interval.

    >>> rate(9, 10)
    '90.0 % (55.5-99.7, n = 10)'
    """
    if not total:
        return "-"
    low, high = binomtest(hits, total).proportion_ci(method="exact")
    return f"{100 * hits / total:.1f} % ({100 * low:.1f}-{100 * high:.1f}, n = {total})"


def count(rows: Sequence[Row], what: str) -> str:
    """The rate at which a key of the rows is true."""
    return rate(sum(bool(row[what]) for row in rows), len(rows))


def share(flags: Iterable[bool]) -> str:
    """The rate of what is true."""
    values = list(flags)
    return rate(sum(values), len(values))


def number(values: Iterable[float | None], how: Callable[..., Any] = np.median) -> str:
    """A summary of what is finite, the median if nothing else."""
    finite = [value for value in values if value is not None and np.isfinite(value)]
    return f"{how(finite):.3g}" if finite else "-"


def high(values: Sequence[float]) -> float:
    """What 95 % stay below."""
    return float(np.quantile(values, 0.95))


def banded(rows: Sequence[Row], what: str, limits: tuple[float, float]) -> list[Row]:
    """Rows in which something is from a limit up to another."""
    return [row for row in rows if limits[0] <= row[what] < limits[1]]


def band(chi2: float) -> str:
    """The band of detectability of a case."""
    return next(name for name, (low, most) in BANDS.items() if low <= chi2 < most)


def listed(rows: Sequence[Row]) -> list[Row]:
    """Cases with effects from the list."""
    return [row for row in rows if row["kind"] not in ("controls", "outside")]


def bars(rows: Sequence[Row]) -> list[Line]:
    """All of them."""
    lines = [*_controls(rows), *_sets(rows), *_wrong(rows), *_outside(rows), *_parameters(rows)]
    return [*lines, *_places(rows), *_forecasts(rows), *_cost(rows)]


def _controls(rows: Sequence[Row]) -> list[Line]:
    controls = [row for row in rows if row["kind"] == "controls"]
    lines = [("false alarms on controls", count(controls, "false_alarm"))]
    for label in ("closed loop", "filtered noise", "quantised"):
        part = [row for row in controls if label in row["concealments"]]
        lines.append((f"false alarms on controls, {label}", count(part, "false_alarm")))
    return lines


def _sets(rows: Sequence[Row]) -> list[Line]:
    named = listed(rows)
    lines = []
    for label, limits in BANDS.items():
        part = banded(named, "chi2_per_dof", limits)
        lines.append((f"exact set, {label}", count(part, "exact")))
        lines.append((f"exact or genuinely tied, {label}", count(part, "tied")))
    for kind, words in (("single", "one effect"), ("two", "two effects"), ("three", "three effects"),
                        ("retuned", "retuned nominal")):  # fmt: skip
        part = [row for row in named if row["kind"] == kind]
        lines.append((f"exact set, {words}", count(part, "exact")))
        lines.append((f"exact or genuinely tied, {words}", count(part, "tied")))
    sizes = [size for row in named for size in row["ties"]]
    lines.append(("cases whose truth is a claimed tie", count(named, "tie_claimed")))
    lines.append(("claimed ties that nobody checked, not counted as ties", count(named, "tie_unchecked")))
    lines.append(("mean size of a tie set", f"{number(sizes, np.mean)} (of {len(sizes)})"))
    return lines


def _wrong(rows: Sequence[Row]) -> list[Line]:
    named = listed(rows)
    given = [row for row in named if row["verdict"] in ("named", "tie")]
    return [
        ("some name wrong", count(named, "any_wrong")),
        ("some name wrong, where names are given", count(given, "any_wrong")),
        ("no name given (none or unknown)", count(named, "abstained")),
        ("detected", count(named, "detected")),
    ]


def _outside(rows: Sequence[Row]) -> list[Line]:
    outside = [row for row in rows if row["kind"] == "outside"]
    ratios, beyond = ([row[f"one_step_learned{which}"] for row in outside] for which in ("", "_beyond_noise"))
    beyond = [ratio for ratio in beyond if np.isfinite(ratio)]
    return [
        ("outside of the list: unknown", share(row["verdict"] == "unknown" for row in outside)),
        ("outside of the list: a name given", count(outside, "any_wrong")),
        ("outside of the list: held-out one step halved by what is learned",
         share(bool(ratio <= HALF) for ratio in ratios)),
        ("outside of the list: held-out one step, learned / before", number(ratios)),
        ("outside of the list: the same, beyond noise", f"{number(beyond)} (median of {len(beyond)})"),
    ]  # fmt: skip


def _parameters(rows: Sequence[Row]) -> list[Line]:
    entries = [entry for row in rows for entry in row["parameters"]]
    lines = [("95 % interval holds the truth", covered(entries))]
    for label, limits in NOISES.items():
        part = [entry["error"] for row in banded(rows, "noise", limits) for entry in row["parameters"]]
        lines.append((f"relative parameter error, {label}", f"{number(part)} (median of {len(part)})"))
    return lines


def covered(entries: Sequence[Mapping[str, Any]]) -> str:
    """How often intervals hold the truth."""
    return share(entry["covered"] for entry in entries if entry["covered"] is not None)


def _places(rows: Sequence[Row]) -> list[Line]:
    places = [place for row in rows for place in row["places"]]
    areas = [area for row in rows for area in row["auc"]]
    return [
        ("right place on the map", share(place["located"] for place in places)),
        ("right place named", share(place["named"] for place in places)),
        ("AUC of the marked region, local effects", f"{number(areas)} (median of {len(areas)})"),
    ]


def _forecasts(rows: Sequence[Row]) -> list[Line]:
    named = listed(rows)
    ratios = [row["free_run_oracle"] for row in named if np.isfinite(row["free_run_oracle"])]
    return [
        ("held-out free run / the oracle's", f"{number(ratios)} (median of {len(ratios)})"),
        ("held-out free run / the oracle's, 95 %", number(ratios, high)),
        ("held-out free run / noise", number(row["free_run"] for row in named)),
        ("held-out one step / noise", number(row["one_step"] for row in named)),
    ]


def _cost(rows: Sequence[Row]) -> list[Line]:
    return [
        ("seconds per case, median", number(row["seconds"] for row in rows)),
        ("seconds per case, 95 %", number((row["seconds"] for row in rows), high)),
        ("seconds of computing per case, median", number(row["cpu_seconds"] for row in rows)),
        ("seconds of computing per case, 95 %", number((row["cpu_seconds"] for row in rows), high)),
        ("memory per case, median, MiB", number(row["peak_mib"] for row in rows)),
        ("memory per case, 95 %, MiB", number((row["peak_mib"] for row in rows), high)),
        ("failed with an error", share(row["verdict"] == "failed" and not row["late"] for row in rows)),
        ("out of time", count(rows, "late")),
    ]
