"""The scores as tables that read well."""

from __future__ import annotations

import itertools
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.concealed import bars
from benchmarks.concealed.bars import Row, count, number, rate, share

EDGES = (0, 0.5, 0.8, 0.95, 0.99, 1.0)
"""Bins of the probability that is claimed."""


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(map(str, line)) + " |" for line in lines)


def report(
    rows: Sequence[Row], missing: Sequence[str], title: str, peers: Mapping[str, Sequence[Row]] | None = None
) -> str:
    """All tables in one text; peers: their rows by name."""
    named = bars.listed(rows)
    found = f"{len(rows)} cases scored" + (f", {len(missing)} without a result." if missing else ".")
    parts = {
        "": table(["", "all"], bars.bars(rows)),
        "By group": groups(named),
        "By effect": effects(named),
        "What was said for each name": confusion(named),
        "Outside of the list": outside(rows),
        "Probability that is claimed": "![](reliability.png)\n\n" + reliability(rows),
        "Place": place(rows),
        "Parameters": parameters(named),
        "Controls": controls(rows),
        "Peers on the same cases": against(rows, peers or {}),
        "Wrong": wrong(rows),
    }
    texts = [f"# {title}", found, *(f"## {name}\n\n{text}" if name else text for name, text in parts.items() if text)]
    return "\n\n".join(texts) + "\n"


def groups(named: Sequence[Row]) -> str:
    """By kind, machine, loop, rate, detectability, noise and concealment."""
    by: dict[str, list[Row]] = defaultdict(list)
    for row in named:
        noise = next(name for name, limits in bars.NOISES.items() if bars.banded([row], "noise", limits))
        concealed = [f"concealed: {label}" for label in row["concealments"]]
        labels = (row["kind"], row["system"], row["loop"], f"{row['rate']} Hz", bars.band(row["chi2_per_dof"]), noise)
        for label in (*labels, *concealed):
            by[label].append(row)
    header = ["group", "exact", "or genuinely tied", "some name wrong", "detected", "free run / oracle's"]
    lines = [
        [label, count(part, "exact"), count(part, "tied"), count(part, "any_wrong"), count(part, "detected"),
         number(row["free_run_oracle"] for row in part)]
        for label, part in sorted(by.items())
    ]  # fmt: skip
    return table(header, lines)


def effects(named: Sequence[Row]) -> str:
    """Each true name in all cases, alone or with others: whether it was named first."""
    hits: dict[str, list[bool]] = defaultdict(list)
    alone: dict[str, list[bool]] = defaultdict(list)
    for row in named:
        for (name, _), hit in zip(row["truths"], row["first"], strict=True):
            hits[name].append(hit)
            if row["kind"] == "single" and row["chi2_per_dof"] >= bars.BANDS["chi2/dof >= 1.3"][0]:
                alone[name].append(row["exact"])
    lines = [[name, share(flags), share(alone[name])] for name, flags in sorted(hits.items())]
    return table(["effect", "named", "exact alone, chi2/dof >= 1.3"], lines)


def _said(row: Row) -> str:
    names = " + ".join(entries[0][0] for entries in row["said"])
    return names if names and row["verdict"] in ("named", "tie") else row["verdict"]


def confusion(named: Sequence[Row]) -> str:
    """Single effects: true name against what was said, with counts; the confusion matrix without its zeros."""
    lines, single = [], [row for row in named if len(row["truths"]) == 1 and row["kind"] == "single"]
    for name in sorted({row["truths"][0][0] for row in single}):
        part = [row for row in single if row["truths"][0][0] == name]
        lines.append([name, f"{sum(row['exact'] for row in part)}/{len(part)}",
                      f"{sum(row['tied'] for row in part)}/{len(part)}", _counted(part)])  # fmt: skip
    return table(["true", "exact", "or tied", "said"], lines)


def _counted(rows: Sequence[Row]) -> str:
    return ", ".join(f"{word} {times}" for word, times in Counter(map(_said, rows)).most_common())


def outside(rows: Sequence[Row]) -> str:
    """What was said of each effect without a name, and what the learned remainder does for forecasts."""
    by: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if row["kind"] == "outside":
            by[row["truths"][0][0]].append(row)
    lines = [
        [name, share(row["verdict"] == "unknown" for row in part), number(row["one_step_learned"] for row in part),
         number(row["free_run_learned"] for row in part), _counted(part)]
        for name, part in sorted(by.items())
    ]  # fmt: skip
    header = ["true", "unknown", "one step, learned / before", "free run, learned / before", "said"]
    return table(header, lines) if lines else ""


def reliability(rows: Sequence[Row]) -> str:
    """How often an effect is right against the probability that is claimed for it."""
    lines = []
    for (low, high), part in binned(rows).items():
        right = rate(sum(good for _, good in part), len(part))
        lines.append([f"{low}-{high}", number((p for p, _ in part), np.mean), right])
    return table(["claimed", "mean", "right"], lines)


def binned(rows: Sequence[Row]) -> dict[tuple[float, float], list[tuple[float, bool]]]:
    """Claimed probabilities and whether the name was right, in bins."""
    pairs = [pair for row in rows for pair in row["probability"]]
    return {
        (low, high): [(p, good) for p, good in pairs if low <= p < high or (high == 1 and p == 1)]
        for low, high in itertools.pairwise(EDGES)
    }


def place(rows: Sequence[Row]) -> str:
    """By what the effect sits on: whether the map shows it, and whether anything is named there."""
    by: dict[str, list[Mapping[str, Any]]] = defaultdict(list)
    for row in rows:
        for entry in row["places"]:
            by[entry["kind"]].append(entry)
    lines = [
        [kind, share(entry["located"] for entry in part), share(entry["named"] for entry in part)]
        for kind, part in sorted(by.items())
    ]
    return table(["on a", "its joint first on the map", "named there"], lines)


def parameters(named: Sequence[Row]) -> str:
    """Relative errors and coverage, by noise and by parameter."""
    by: dict[str, list[Mapping[str, Any]]] = {"all": [entry for row in named for entry in row["parameters"]]}
    for label, limits in bars.NOISES.items():
        by[label] = [entry for row in bars.banded(named, "noise", limits) for entry in row["parameters"]]
    for entry in sorted(by["all"], key=lambda entry: (entry["effect"], entry["parameter"])):
        by.setdefault(f"{entry['effect']}.{entry['parameter']}", []).append(entry)
    lines = [[label, number(entry["error"] for entry in part), bars.covered(part)] for label, part in by.items()]
    return table(["", "relative error, median", "95 % interval holds the truth"], lines)


def controls(rows: Sequence[Row]) -> str:
    """False alarms by group."""
    by: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if row["kind"] == "controls":
            for label in (row["system"], row["loop"], *row["concealments"]):
                by[label].append(row)
    return table(["group", "false alarms"], [[name, count(part, "false_alarm")] for name, part in sorted(by.items())])


def against(rows: Sequence[Row], peers: Mapping[str, Sequence[Row]]) -> str:
    """This and others, each pair on the cases that both have."""
    lines, here = [], {row["case"]: row for row in rows}
    for name, theirs in peers.items():
        if not theirs:
            continue
        common = [(here[row["case"]], row) for row in theirs if row["case"] in here]
        for who, part in (("this", [ours for ours, _ in common]), (name, [row for _, row in common])):
            named, alone = bars.listed(part), [row for row in part if row["kind"] == "controls"]
            lines.append([who, count(named, "exact"), count(named, "any_wrong"), count(named, "detected"),
                          count(alone, "false_alarm"), number(row["seconds"] for row in part)])  # fmt: skip
    header = ["", "exact", "some name wrong", "detected", "false alarms", "seconds, median"]
    return table(header, lines) if lines else ""


def wrong(rows: Sequence[Row]) -> str:
    """Every case with a wrong name, and every false alarm."""
    lines = [
        [row["case"], row["kind"], row["system"], f"{row['chi2_per_dof']:.3g}", _list(row["truths"]), row["verdict"],
         _list([entries[0] for entries in row["said"]])]
        for row in rows if row["any_wrong"] or row["false_alarm"]
    ]  # fmt: skip
    return table(["case", "kind", "system", "chi2/dof", "truth", "verdict", "said"], lines)


def _list(entries: Sequence[tuple[str, str]]) -> str:
    return ", ".join(f"{name} @ {target}" for name, target in entries) or "nothing"
