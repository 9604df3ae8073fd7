"""The scores as tables that read well."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

Row = Mapping[str, Any]


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


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def _number(values: Sequence[float], how: Callable[..., Any] = np.median) -> str:
    finite = [value for value in values if np.isfinite(value)]
    return f"{how(finite):.3g}" if finite else "-"


def band(chi2: float) -> str:
    """The band of detectability of a case."""
    return "chi2/dof >= 1.3" if chi2 >= 1.3 else "chi2/dof 1.05-1.3" if chi2 >= 1.05 else "chi2/dof < 1.05"


def report(rows: Sequence[Row], missing: Sequence[str], title: str) -> str:
    """All tables in one text."""
    named = [row for row in rows if row["kind"] not in ("controls", "outside")]
    parts = [f"# {title}", f"{len(rows)} cases scored" + (f", {len(missing)} without a result." if missing else ".")]
    parts += [_summary(rows, named), "## By group\n\n" + _groups(named)]
    parts += [
        "## What was said for each name\n\n" + confusion(named),
        "## Probability that is claimed\n\n" + reliability(rows),
    ]
    parts += [
        "## Parameters\n\n" + parameters(named),
        "## Controls\n\n" + _controls(rows),
        "## Wrong\n\n" + _wrong(rows),
    ]
    return "\n\n".join(parts) + "\n"


def _summary(rows: Sequence[Row], named: Sequence[Row]) -> str:
    controls = [row for row in rows if row["kind"] == "controls"]
    outside = [row for row in rows if row["kind"] == "outside"]
    visible = [row for row in named if row["chi2_per_dof"] >= 1.3]
    placed = [row for row in named + outside if np.isfinite(row["placed"])]
    areas = [area for row in rows for area in row["auc"]]
    lines = [
        ("exact set", count(named, "exact")),
        ("exact set, chi2/dof >= 1.3", count(visible, "exact")),
        ("tie set holds the truth", count(named, "tied")),
        ("tie set holds the truth, chi2/dof >= 1.3", count(visible, "tied")),
        ("mean size of a tie set", _number([row["ties"] for row in named], np.mean)),
        ("some name wrong", count(named, "any_wrong")),
        ("abstained (none or unknown)", count(named, "abstained")),
        ("detected", count(named, "detected")),
        ("false alarms on controls", count(controls, "false_alarm")),
        ("controls called unknown", rate(sum(row["verdict"] == "unknown" for row in controls), len(controls))),
        ("outside of the list: unknown", rate(sum(row["verdict"] == "unknown" for row in outside), len(outside))),
        ("outside of the list: a name given", rate(sum(row["any_wrong"] for row in outside), len(outside))),
        ("failed with an error", rate(sum(row["verdict"] == "failed" for row in rows), len(rows))),
        ("right place", rate(sum(row["placed"] == 1 for row in placed), len(placed))),
        ("AUC of the region, local effects", f"{_number(areas)} (median of {len(areas)})"),
        ("held-out free run / noise", _number([row["free_run"] for row in named])),
        ("held-out one step / noise", _number([row["one_step"] for row in named])),
        ("seconds per case, median", _number([row["seconds"] for row in rows])),
        ("seconds per case, 95 %", _number([row["seconds"] for row in rows], lambda x: np.quantile(x, 0.95))),
    ]
    return table(["", "all"], lines)


def _groups(named: Sequence[Row]) -> str:
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in named:
        for label in (row["kind"], row["system"], row["loop"], f"{row['rate']} Hz", band(row["chi2_per_dof"])):
            groups[label].append(row)
        for label in row["concealments"]:
            groups[f"concealed: {label}"].append(row)
    header = ["group", "exact", "tied", "wrong", "detected", "free run / noise"]
    lines = [
        [label, count(part, "exact"), count(part, "tied"), count(part, "any_wrong"), count(part, "detected"),
         _number([row["free_run"] for row in part])]
        for label, part in sorted(groups.items())
    ]  # fmt: skip
    return table(header, lines)


def _said(row: Row) -> str:
    names = " + ".join(entries[0][0] for entries in row["said"])
    return names if names and not row["abstained"] else row["verdict"]


def confusion(named: Sequence[Row]) -> str:
    """Single effects: true name against what was said, with counts; the confusion matrix without its zeros."""
    lines, single = [], [row for row in named if len(row["truths"]) == 1 and row["kind"] == "single"]
    for name in sorted({row["truths"][0][0] for row in single}):
        part = [row for row in single if row["truths"][0][0] == name]
        said = Counter(_said(row) for row in part)
        lines.append([name, f"{sum(row['exact'] for row in part)}/{len(part)}",
                      f"{sum(row['tied'] for row in part)}/{len(part)}",
                      ", ".join(f"{word} {number}" for word, number in said.most_common())])  # fmt: skip
    return table(["true", "exact", "tied", "said"], lines)


def reliability(rows: Sequence[Row]) -> str:
    """How often an effect is right against the probability that is claimed for it."""
    pairs = [pair for row in rows for pair in row["probability"]]
    edges = (0, 0.5, 0.8, 0.95, 0.99, 1.0)
    lines = []
    for low, high in itertools.pairwise(edges):
        part = [(p, good) for p, good in pairs if low <= p < high or (high == 1 and p == 1)]
        mean = _number([p for p, _ in part], np.mean)
        lines.append([f"{low}-{high}", mean, rate(sum(good for _, good in part), len(part))])
    return table(["claimed", "mean", "right"], lines)


def parameters(named: Sequence[Row]) -> str:
    """Relative errors and coverage, by noise."""
    edges = (0, 5e-4, 1.5e-3, 1)
    lines = []
    for low, high in itertools.pairwise(edges):
        part = [entry for row in named if low <= row["noise"] < high for entry in row["parameters"]]
        covered = [entry["covered"] for entry in part if entry["covered"] is not None]
        label = f"noise {1e3 * low:g}-{1e3 * high:g} m(rad)" if high < 1 else f"noise > {1e3 * low:g} m(rad)"
        lines.append([label, _number([entry["error"] for entry in part]), rate(sum(covered), len(covered))])
    by_name: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for row in named:
        for entry in row["parameters"]:
            by_name[f"{entry['effect']}.{entry['parameter']}"].append(entry)
    for label, part in sorted(by_name.items()):
        covered = [entry["covered"] for entry in part if entry["covered"] is not None]
        lines.append([label, _number([entry["error"] for entry in part]), rate(sum(covered), len(covered))])
    return table(["", "relative error, median", "95 % interval covers"], lines)


def _controls(rows: Sequence[Row]) -> str:
    controls = [row for row in rows if row["kind"] == "controls"]
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in controls:
        for label in (row["system"], row["loop"], *row["concealments"]):
            groups[label].append(row)
    return table(
        ["group", "false alarms"], [[name, count(part, "false_alarm")] for name, part in sorted(groups.items())]
    )


def _wrong(rows: Sequence[Row]) -> str:
    lines = [
        [row["case"], row["system"], f"{row['chi2_per_dof']:.3g}", _list(row["truths"]), row["verdict"],
         _list([entries[0] for entries in row["said"]])]
        for row in rows if row["any_wrong"] or row["false_alarm"]
    ]  # fmt: skip
    return table(["case", "system", "chi2/dof", "truth", "verdict", "said"], lines)


def _list(entries: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"{name} @ {target}" for name, target in entries) or "nothing"
