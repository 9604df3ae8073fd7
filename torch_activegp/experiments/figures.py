"""The paper's three figures: maximum variance, error and discrepancy over the episodes."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from torch_activegp.experiments.methods import METHODS

PANELS = {
    "max_variance": "Largest variance on the test grid",
    "mse": "Mean squared error on the test grid",
    "discrepancy": "Discrepancy |p0 - f| at visited points",
}
"""The column of each figure and its title."""

_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#777777", "#E69F00")
_RC = {"svg.hashsalt": "torch_activegp", "font.size": 10, "axes.spines.top": False, "axes.spines.right": False}


def draw_figures(table: pd.DataFrame, folder: Path, title: str) -> list[Path]:
    """Draw each figure alone and all three side by side, as PNG and SVG.

    Lines are means over the trials, bands reach from the smallest to the largest.

    Args:
        table: from :func:`~torch_activegp.experiments.records_table`.
        folder: where to write.
        title: of the joint figure.

    Returns:
        The files.
    """
    files = []
    with matplotlib.rc_context(_RC):
        for column in PANELS:
            figure = Figure(figsize=(5, 3.6), layout="constrained")
            _draw(figure.subplots(), table, column, legend=True)
            files += _save(figure, folder / column)
        figure = Figure(figsize=(13, 4), layout="constrained")
        for axes, column in zip(figure.subplots(1, 3), PANELS, strict=True):
            _draw(axes, table, column, legend=column == "mse")
        figure.suptitle(title)
        files += _save(figure, folder / "figures")
    return files


def _draw(axes: Axes, table: pd.DataFrame, column: str, *, legend: bool) -> None:
    for index, method in enumerate(table["method"].unique()):
        group = table[table["method"] == method].groupby("episode")[column]
        colour = _COLOURS[index % len(_COLOURS)]
        mean = group.mean()
        axes.plot(mean.index, mean, color=colour, label=METHODS[method].title, linewidth=1.6)
        axes.fill_between(mean.index, group.min(), group.max(), color=colour, alpha=0.15, linewidth=0)
    if column == "mse":
        axes.set_yscale("log")
    axes.set_title(PANELS[column], fontsize=10)
    axes.set_xlabel("episode")
    if legend:
        axes.legend(frameon=False, fontsize=8)


def _save(figure: Figure, stem: Path) -> list[Path]:
    files = [stem.with_suffix(suffix) for suffix in (".png", ".svg")]
    for file in files:
        temporary = file.with_name(file.name + ".part")
        metadata = {"Date": None} if file.suffix == ".svg" else {}
        figure.savefig(temporary, format=file.suffix[1:], dpi=150, metadata=metadata)
        temporary.replace(file)
    return files
