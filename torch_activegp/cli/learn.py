"""``torch-activegp learn``: where a simulator is wrong, from recordings."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from torch_activegp.cli.app import app, console, results
from torch_activegp.cli.options import RECORDINGS, Columns, Holdout, Model, Seed, output_folder, place
from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments.forecast import KINDS
from torch_activegp.experiments.forecast_figure import draw_forecast
from torch_activegp.experiments.forecast_report import predictions, summary
from torch_activegp.experiments.learn import WINDOW, Learned
from torch_activegp.experiments.learn import learn as learn_from
from torch_activegp.experiments.learned_model import save_learned
from torch_activegp.experiments.output import check_output, open_output, write_json, write_table
from torch_activegp.experiments.recorded import fitted_by_mistake, load_apart
from torch_activegp.experiments.workers import one_thread

_TITLES = {"one_step": "one step of {dt:.4g} s", "window": "windows of {window:g} s", "free_run": "free run"}


@app.command()
def learn(
    model: Model,
    recordings: Annotated[list[str], typer.Argument(help=f"To learn from: {RECORDINGS}", metavar="RECORDING...")],
    holdout: Holdout = None,
    columns: Columns = None,
    dt: Annotated[
        float | None,
        typer.Option(
            help="Time step of the model, s. Without it, as long as the state changes a little, well above noise."
        ),
    ] = None,
    max_points: Annotated[int, typer.Option(min=20, help="Transitions that the GP learns from, at most.")] = 800,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(parser=place, help="Output folder: new or empty. By default runs/learn-MODEL.", metavar="FOLDER"),
    ] = None,
) -> None:
    """Learn from recordings where a simulator is wrong, and say how much better simulator + GP forecasts.

    Example:  `torch-activegp learn emps emps:train --holdout emps:test`

    Your own:  `torch-activegp learn arm.xml run1.csv run2.csv --holdout run3.csv`

    Errors are those on the held-out recordings, in standard deviations of what was measured (1: as bad as the mean;
    0: right) and in units: one step ahead; over windows of a second; and free, from the first state to the end.

    Writes summary.json, predictions.csv (the free runs), forecast.png and .svg, and model.pt, which
    torch_activegp.experiments.load_learned loads as a simulator.
    """
    began = time.perf_counter()
    settings = {
        "command": "learn",
        "model": model,
        "recordings": recordings,
        "holdout": holdout or [],
        "columns": None if columns is None else str(columns),
        "dt": dt,
        "max_points": max_points,
        "seed": seed,
    }
    folder = output_folder(out, "learn", Path(model).stem if Path(model).is_file() else model)
    _check_new(folder, settings)
    train, test = load_apart(recordings, holdout or [], columns)
    if mistake := fitted_by_mistake(recordings, holdout or []):
        console.print(mistake, highlight=False, markup=False, soft_wrap=True)
    with one_thread(), console.status("learning ..."):
        outcome = learn_from(model, train, test, dt=dt, max_points=max_points, seed=seed)
    open_output(folder, settings, resume=False)
    write_json(
        folder / "summary.json", {**settings, **summary(outcome), "seconds": round(time.perf_counter() - began, 2)}
    )
    write_table(folder / "predictions.csv", predictions(outcome))
    save_learned(folder / "model.pt", outcome)
    draw_forecast(outcome, folder)
    for note in outcome.notes:
        console.print(note, highlight=False, markup=False, soft_wrap=True)
    results.print(_table(outcome))
    results.print(
        f"{outcome.guard}\n{outcome.window_guard}\nSee {folder / 'forecast.png'}.",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )


def _check_new(folder: Path, settings: dict[str, Any]) -> None:
    if folder.is_dir() and any(folder.iterdir()):
        raise ConfigurationError(f"The output folder {folder} is not empty. Choose another --out.")
    check_output(folder, settings, resume=False)


def _table(outcome: Learned) -> Table:
    table = Table(title=f"Errors on {', '.join(outcome.labels)}", caption=_caption(outcome))
    for heading in ("forecast", "state"):
        table.add_column(heading, no_wrap=True)
    for heading in ("simulator", "simulator + GP", "times better"):
        table.add_column(heading, justify="right")
    for kind in KINDS:
        before, after = getattr(outcome.before, kind), getattr(outcome.after, kind)
        title = _TITLES[kind].format(dt=outcome.simulator.dt, window=WINDOW)
        pairs = [(before.position_nrmse, after.position_nrmse)]
        pairs += [(before.rmse[name], after.rmse[name]) for name in before.rmse]
        labels = ["positions [std]", *before.rmse]
        for row, (label, (first, second)) in enumerate(zip(labels, pairs, strict=True)):
            ratio = f"{first / second:.3g}" if second > 0 and first < float("inf") else "-"
            cells = (_cell(first, before.diverged_after), _cell(second, after.diverged_after), ratio)
            table.add_row("" if row else title, label, *cells, end_section=row == len(labels) - 1)
    return table


def _cell(error: float, diverged_after: float | None) -> str:
    return f"{error:.3g}" if diverged_after is None else f"diverged at {diverged_after:.3g} s"


def _caption(outcome: Learned) -> str:
    return (
        "positions: in standard deviations of what was measured; states: in m or rad, m/s or rad/s. "
        f"Noise of the measured positions: {outcome.noise:.2g} std."
    )
