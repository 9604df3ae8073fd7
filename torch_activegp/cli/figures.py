"""``torch-activegp figures``: the paper's figures."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
import typer
from rich.table import Table

from torch_activegp.cli.app import app, console, interruptible, results
from torch_activegp.cli.exploring import (
    BoundsOption,
    Episodes,
    Horizon,
    Out,
    Prior,
    Resume,
    Steps,
    System,
    parse_bounds,
)
from torch_activegp.cli.options import Seed, output_folder
from torch_activegp.cli.progress import EpisodeProgress, show_time
from torch_activegp.cli.tasks import check_methods, load_task
from torch_activegp.experiments import (
    METHODS,
    Budget,
    GridEvaluation,
    check_claims,
    draw_figures,
    make_trials,
    records_table,
    run_study,
)
from torch_activegp.experiments.claims import claims_as_dicts, claims_as_markdown
from torch_activegp.experiments.methods import PAPER_METHODS
from torch_activegp.experiments.output import check_output, open_output, write_json, write_table, write_text
from torch_activegp.experiments.study import METRICS

_MAY_GROW = ("episodes", "trials", "methods")
_COLOURS = {"held": "green", "not held": "red", "not distinguishable yet": "yellow"}


@app.command()
def figures(
    system: System = "pendulum",
    prior: Prior = None,
    trials: Annotated[int, typer.Option(min=1, help="Trials of each method, with seeds SEED, SEED + 1, ...")] = 10,
    methods: Annotated[str, typer.Option(help=f"Separated by commas, of {', '.join(METHODS)}.")] = ",".join(
        PAPER_METHODS
    ),
    episodes: Episodes = 30,
    steps: Steps = 10,
    horizon: Horizon = 10,
    seed: Seed = 0,
    bounds: BoundsOption = None,
    jobs: Annotated[int, typer.Option(min=0, help="Processes; 0: one for each core.")] = 0,
    out: Out = None,
    resume: Resume = False,
) -> None:
    """Run the paper's method against its baselines and draw the paper's three figures.

    All methods share the GP and the planner. The results depend on the seeds alone, not on --jobs.

    Example:  `torch-activegp figures pendulum --trials 2 --episodes 15 --out runs/figures`

    Writes metrics.csv (one row for each episode of each trial), figures.png and .svg (and each figure alone: mean over
    the trials, band from smallest to largest), claims.md and summary.json (the paper's claims: held or not held),
    settings.json, and a checkpoint for each trial. --resume finishes a run that was interrupted, or goes on with more
    --episodes, --trials or --methods.
    """
    began = time.perf_counter()
    names = check_methods([name.strip() for name in methods.split(",") if name.strip()])
    settings = {
        "command": "figures",
        "system": system,
        "prior": prior,
        "bounds": parse_bounds(bounds),
        "methods": names,
        "trials": trials,
        "seed": seed,
        "steps": steps,
        "horizon": horizon,
        "episodes": episodes,
    }
    folder = output_folder(out, "figures", system)
    check_output(folder, settings, resume=resume, may_grow=_MAY_GROW)
    make_task = partial(load_task, system, prior, parse_bounds(bounds))
    task = make_task()
    prior_mse = GridEvaluation(task).prior_mse
    budget = Budget(episodes=episodes, episode_length=steps, planning_horizon=horizon)
    open_output(folder, settings, resume=resume, may_grow=_MAY_GROW)
    if task.description:
        console.print(f"{task.name}: {task.description}", highlight=False, soft_wrap=True)
    schedule = make_trials(names, trials, seed)
    with interruptible(folder):
        with EpisodeProgress(console, "running", episodes * len(schedule)) as progress:
            records = run_study(
                make_task,
                schedule,
                budget,
                folder / "trials",
                num_jobs=jobs,
                on_step=lambda step: progress.advance(restored=step.restored),
            )
        table = records_table(records, names)
        _write(folder, table, settings, unit=task.unit, prior_mse=prior_mse, began=began)


def _write(
    folder: Path, table: pd.DataFrame, settings: dict[str, Any], *, unit: str, prior_mse: float, began: float
) -> None:
    several = settings["trials"] > 1
    title = f"{settings['system']}, {settings['trials']} trial{'s' * several}"
    heading = title + ": mean, and band from smallest to largest" * several
    claims = check_claims(table)
    write_table(folder / "metrics.csv", table)
    draw_figures(table, folder, heading, unit=unit, prior_mse=prior_mse)
    write_text(folder / "claims.md", claims_as_markdown(claims, f"{title} of {settings['episodes']} episodes"))
    seconds = time.perf_counter() - began
    summary = {
        **settings,
        "prior_mse": prior_mse,
        "final": _final(table),
        "claims": claims_as_dicts(claims),
        "seconds": round(seconds, 1),
    }
    write_json(folder / "summary.json", summary)
    results.print(_overview(table, prior_mse))
    for claim in claims:
        results.print(f"[{_COLOURS[claim.verdict]}]{claim.verdict}[/]: {claim.text}", highlight=False, soft_wrap=True)
        results.print(f"    {claim.seen}", highlight=False, markup=False, soft_wrap=True)
    results.print(f"Done in {show_time(seconds)}. See {folder / 'figures.png'}.", highlight=False, soft_wrap=True)


def _final(table: pd.DataFrame) -> dict[str, dict[str, dict[str, float]]]:
    last = table[table["episode"] == table["episode"].max()]
    stats: Sequence[str] = ("mean", "min", "max")
    found = last.groupby("method", sort=False)[list(METRICS)].agg(list(stats))
    return {
        str(method): {column: {stat: float(row[column][stat]) for stat in stats} for column in METRICS}
        for method, row in found.iterrows()
    }


def _overview(table: pd.DataFrame, prior_mse: float) -> Table:
    view = Table(title=f"After the last episode, mean of the trials (simulator alone: MSE {prior_mse:.3g})")
    for heading in ("method", "MSE", "max variance", "mean |p0 - f| visited"):
        view.add_column(heading, justify="left" if heading == "method" else "right")
    last = table[table["episode"] == table["episode"].max()].groupby("method", sort=False).mean(numeric_only=True)
    visited = table.groupby("method", sort=False)["discrepancy"].mean()
    for method, row in last.iterrows():
        cells = (f"{value:.3g}" for value in (row["mse"], row["max_variance"], visited[method]))
        view.add_row(METHODS[str(method)].title, *cells)
    return view
