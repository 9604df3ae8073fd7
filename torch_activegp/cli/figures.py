"""``torch-activegp figures``: the paper's figures."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import pandas as pd
import typer
from rich.table import Table

from torch_activegp.cli.app import app, console
from torch_activegp.cli.options import Episodes, Horizon, Out, Resume, Seed, Steps
from torch_activegp.cli.progress import progress_bar
from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments import (
    METHODS,
    TASKS,
    Budget,
    GridEvaluation,
    check_claims,
    draw_figures,
    records_table,
    run_study,
)
from torch_activegp.experiments.claims import claims_as_dicts
from torch_activegp.experiments.output import open_output, write_json, write_table

_PAPER = "discrepancy,opax,opax-prior,sigma,random"


@app.command()
def figures(
    system: Annotated[str, typer.Argument(help=f"One of {', '.join(TASKS)}.")] = "pendulum",
    trials: Annotated[int, typer.Option(help="Trials of each method, with seeds SEED, SEED + 1, ...")] = 10,
    methods: Annotated[str, typer.Option(help=f"Comma-separated, of {', '.join(METHODS)}.")] = _PAPER,
    episodes: Episodes = 30,
    steps: Steps = 10,
    horizon: Horizon = 10,
    seed: Seed = 0,
    jobs: Annotated[int, typer.Option(help="Processes; -1 for one a core.")] = -1,
    out: Out = Path("figures-out"),
    resume: Resume = False,
) -> None:
    """Run the paper's methods against each other and draw its three figures.

    Writes metrics.csv (the same for the same seeds), summary.json with the paper's claims (held or not held), and the
    figures as PNG and SVG: mean over the trials, band from smallest to largest. --resume finishes an interrupted study.

    Example: torch-activegp figures pendulum --trials 2 --episodes 15 --out figures-out
    """
    began = time.perf_counter()
    names = [name.strip() for name in methods.split(",") if name.strip()]
    _check(system, trials, names, jobs)
    budget = Budget(episodes=episodes, episode_length=steps, planning_horizon=horizon)
    settings = {"command": "figures", "system": system, "methods": names, "trials": trials, "seed": seed}
    open_output(out, {**settings, "episodes": episodes, "steps": steps, "horizon": horizon}, resume=resume)
    results = []
    with progress_bar(console, "trials") as progress:
        bar = progress.add_task(f"{system}", total=trials * len(names))
        study = run_study(TASKS[system], names, trials, budget, out / "trials", first_seed=seed, num_jobs=jobs)
        for trial, records in study:
            results.append((trial, records))
            progress.console.print(f"{trial.method}, trial {trial.seed}: {records[-1]}", highlight=False)
            progress.advance(bar)
    table = records_table(results, names)
    write_table(out / "metrics.csv", table)
    draw_figures(table, out, f"{system}: mean of {trials} trials, band from smallest to largest")
    claims = check_claims(table)
    prior_mse = GridEvaluation(TASKS[system]()).prior_mse
    write_json(
        out / "summary.json",
        {
            **settings,
            "prior_mse": prior_mse,
            "final": _final(table),
            "claims": claims_as_dicts(claims),
            "seconds": round(time.perf_counter() - began, 1),
        },
    )
    _print_summary(table, prior_mse)
    for claim in claims:
        mark = "[green]held[/]" if claim.held else "[yellow]not held[/]"
        console.print(f"{mark}: {claim.text} {claim.seen}", highlight=False)
    console.print(f"Figures: {out / 'figures.png'}")


def _check(system: str, trials: int, names: list[str], jobs: int) -> None:
    unknown = [name for name in names if name not in METHODS]
    if system not in TASKS:
        raise ConfigurationError(f"Unknown system {system!r}. Choose one of {', '.join(TASKS)}.")
    if unknown or not names or len(set(names)) < len(names):
        raise ConfigurationError(f"Wanted distinct methods of {', '.join(METHODS)}, found {', '.join(names) or 'none'}.")
    if trials < 1 or jobs == 0:
        raise ConfigurationError(f"Wanted --trials >= 1 and --jobs other than 0, found {trials} and {jobs}.")


def _final(table: pd.DataFrame) -> dict[str, dict[str, dict[str, float]]]:
    last = table[table["episode"] == table["episode"].max()]
    columns = ["max_variance", "mse", "discrepancy"]
    stats = last.groupby("method", sort=False)[columns].agg(["mean", "min", "max"])
    return {
        str(method): {column: {stat: float(row[column][stat]) for stat in ("mean", "min", "max")} for column in columns}
        for method, row in stats.iterrows()
    }


def _print_summary(table: pd.DataFrame, prior_mse: float) -> None:
    view = Table(title=f"After the last episode, mean of the trials (simulator alone: MSE {prior_mse:.3g})")
    for heading in ("method", "MSE", "max variance", "mean |p0 - f| visited"):
        view.add_column(heading, justify="left" if heading == "method" else "right")
    last = table[table["episode"] == table["episode"].max()].groupby("method", sort=False).mean(numeric_only=True)
    visited = table.groupby("method", sort=False)["discrepancy"].mean()
    for method, row in last.iterrows():
        cells = (f"{value:.3g}" for value in (row["mse"], row["max_variance"], visited[method]))
        view.add_row(METHODS[str(method)].title, *cells)
    console.print(view)
