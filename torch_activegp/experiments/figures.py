"""The paper's three figures: maximum variance, error and discrepancy over the episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from torch_activegp.experiments.methods import METHODS
from torch_activegp.experiments.picture import LOOK, save_picture

_STYLES = (
    ("#0072B2", "-"),
    ("#D55E00", "--"),
    ("#E69F00", (0, (5, 1.5))),
    ("#009E73", "-."),
    ("#CC79A7", "-"),
    ("#000000", "-"),
    ("#56B4E9", "--"),
    ("#777777", ":"),
)
"""Colour (Okabe and Ito) and line style of each method, in the order of METHODS: told apart without colours, too."""


@dataclass(frozen=True)
class _Panel:
    column: str
    title: str
    label: str


_PANELS = (
    _Panel("max_variance", "Maximum variance on the test points", "largest variance [signal variance]"),
    _Panel("mse", "Error on the test points", "mean squared error [({unit})²]"),
    _Panel("discrepancy", "Discrepancy at visited points", "mean |p0 - f| [{unit}]"),
)


def draw_figures(
    table: pd.DataFrame, folder: Path, title: str, *, unit: str = "units of the states", prior_mse: float | None = None
) -> list[Path]:
    """Draw each figure alone and all three side by side, as PNG and SVG; the same bytes for the same table.

    Lines are means over the trials, bands reach from the smallest to the largest.

    Args:
        table: from :func:`~torch_activegp.experiments.records_table`.
        folder: where to write.
        title: of the joint figure.
        unit: of the states.
        prior_mse: error of the imperfect simulator alone; drawn as a horizontal line.

    Returns:
        The files.

    Raises:
        ConfigurationError: the folder cannot be written.
    """
    files = []
    with matplotlib.rc_context(LOOK):
        for panel in _PANELS:
            figure = Figure(figsize=(5.2, 4.4), layout="constrained")
            _draw_all(figure, table, [panel], unit, prior_mse)
            files += save_picture(figure, folder / panel.column)
        figure = Figure(figsize=(13, 4.6), layout="constrained")
        _draw_all(figure, table, _PANELS, unit, prior_mse)
        figure.suptitle(title)
        files += save_picture(figure, folder / "figures")
    return files


def _draw_all(
    figure: Figure, table: pd.DataFrame, panels: Sequence[_Panel], unit: str, prior_mse: float | None
) -> None:
    row = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, panel in zip(row, panels, strict=True):
        _draw(axes, table, panel.column)
        if panel.column == "mse" and prior_mse:
            axes.axhline(prior_mse, color="black", linewidth=1, linestyle=(0, (1, 1)), label="Simulator alone")
        axes.set_title(panel.title, fontsize=11)
        axes.set_xlabel("episode")
        axes.set_ylabel(panel.label.format(unit=unit))
    handles = {label: handle for axes in row for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)}
    columns = 2 if len(panels) == 1 else min(len(handles), 4)
    figure.legend(
        handles.values(), handles.keys(), loc="outside lower center", ncols=columns, frameon=False, fontsize=9
    )


def _draw(axes: Axes, table: pd.DataFrame, column: str) -> None:
    present = set(table["method"])
    for index, (name, method) in enumerate(METHODS.items()):
        if name not in present:
            continue
        colour, style = _STYLES[index % len(_STYLES)]
        group = table[table["method"] == name].groupby("episode")[column]
        mean = group.mean()
        marker = "o" if len(mean) == 1 else None
        axes.fill_between(mean.index, group.min(), group.max(), color=colour, alpha=0.1, linewidth=0)
        axes.plot(
            mean.index,
            mean,
            color=colour,
            linestyle=style,
            linewidth=2.2 if name in ("discrepancy", "directed") else 1.4,
            marker=marker,
            label=method.title,
            zorder=4 if index == 0 else 3,
        )
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(table["episode"].min() - 0.5, table["episode"].max() + 0.5)
    if column == "mse":
        axes.set_yscale("log")
    else:
        _show_no_noise(axes, table[column].min(), table[column].max())


def _show_no_noise(axes: Axes, low: float, high: float) -> None:
    """Scale an axis to the data, but so that it shows no differences below a twentieth of the values."""
    spare = max(high - low, 0.2 * high, 1e-12) - (high - low)
    low = max(low - spare, 0.0)
    margin = 0.05 * (high - low + spare)
    axes.set_ylim(low - margin if low > margin else 0.0, high + margin)
    axes.ticklabel_format(axis="y", useOffset=False)
