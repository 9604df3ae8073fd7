"""The reliability diagram: how often names are right against the probability that is claimed for them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import binomtest

from benchmarks.concealed.bars import Row
from benchmarks.concealed.markdown import binned


def draw_reliability(rows: Sequence[Row], path: Path) -> None:
    """Write the diagram, with exact 95 % intervals and the number of names in each bin."""
    figure = Figure(figsize=(4, 4), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    for part in binned(rows).values():
        if not part:
            continue
        claimed, hits = float(np.mean([p for p, _ in part])), sum(good for _, good in part)
        right, interval = hits / len(part), binomtest(hits, len(part)).proportion_ci(method="exact")
        axes.errorbar(
            claimed, right, [[right - interval.low], [interval.high - right]], marker="o", color="C0", capsize=2
        )
        axes.annotate(str(len(part)), (claimed, right), textcoords="offset points", xytext=(-8, 6), ha="right")
    axes.set(xlabel="claimed", ylabel="right", xlim=(0, 1.02), ylim=(0, 1.02), title="Names: claimed and right")
    figure.savefig(path, dpi=150)
