"""``torch-activegp evaluate``: how well a simulator forecasts recordings, as it is."""

from __future__ import annotations

import glob
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from torch_activegp.cli.app import app, console, results
from torch_activegp.cli.diagnose import FORECASTS
from torch_activegp.cli.folders import check_free, results_in
from torch_activegp.cli.models import find_model
from torch_activegp.cli.options import RECORDINGS, Columns, Model, place
from torch_activegp.experiments.output import write_json
from torch_activegp.experiments.recorded import load_named
from torch_activegp.experiments.workers import one_thread
from torch_activegp.report.numbers import number


@app.command()
def evaluate(
    model: Model,
    recordings: Annotated[list[str], typer.Argument(help=f"To forecast: {RECORDINGS}", metavar="RECORDING...")],
    columns: Columns = None,
    out: Annotated[
        Path | None,
        typer.Option(parser=place, help="Also write the errors there; never over another file.", metavar="FILE.json"),
    ] = None,
) -> None:
    """Say how far a simulator's forecasts are from recordings; nothing is fitted.

    Example:  `torch-activegp evaluate emps emps:test`

    After a diagnosis:  `torch-activegp evaluate runs/diagnose-arm/corrected.xml run4.csv`, or corrected.pt, learned.pt

    Errors are root mean squares over the recorded positions, in standard deviations of what was measured (1: as bad as
    the mean; 0: right): one step of 0.1 s beyond half a second that the model was fitted to, and free, from one fitted
    state to the end. Next to each stands the noise of the measurement, as it seems in these recordings; the right model
    comes down to about that.
    """
    if out is not None:
        check_free(out.parent, [glob.escape(out.name)], one_file=True)
    simulator = find_model(model)
    runs = load_named(recordings, columns)
    from torch_activegp.diagnosis import evaluate as evaluate_from

    with one_thread(), console.status("forecasting ..."):
        errors = evaluate_from(simulator, runs)
    for note in errors.get("notes") or ():
        console.print(note, highlight=False, markup=False, soft_wrap=True)
    results.print(_table(errors, model))
    if out is not None:
        with results_in(out.parent):
            write_json(out, errors)
        results.print(f"See {out}.", highlight=False, markup=False, soft_wrap=True)


def _table(errors: Mapping[str, Any], model: str) -> Table:
    table = Table(title=f"Errors of {model}", caption="in standard deviations of what was measured")
    for heading in ("recording", "position"):
        table.add_column(heading, overflow="fold")
    for title in FORECASTS.values():
        table.add_column(title, justify="right", no_wrap=True)
        table.add_column("noise", justify="right", no_wrap=True)
    runs = errors["runs"]
    for index, run in enumerate(runs, 1):
        table.add_row(run["run"], run["channel"], *_cells(run), end_section=index == len(runs))
    table.add_row("all", "", *_cells(errors))
    return table


def _cells(errors: Mapping[str, Any]) -> list[str]:
    return [number((errors.get(key) or {}).get(column)) for key in FORECASTS for column in ("error", "noise")]
