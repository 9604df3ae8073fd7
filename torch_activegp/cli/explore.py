"""``torch-activegp explore``: one active-learning run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from torch_activegp.cli.app import app, console
from torch_activegp.cli.options import Episodes, Horizon, Out, Resume, Seed, Steps
from torch_activegp.cli.progress import progress_bar
from torch_activegp.cli.tasks import load_task
from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments import METHODS, Budget, Trial, draw_figures, make_loop, records_table
from torch_activegp.experiments.output import open_output, write_json, write_table


@app.command()
def explore(
    system: Annotated[
        str,
        typer.Argument(help="pendulum, pendulum-brake, an MJCF file, or package.module:factory (a Simulator or Task)."),
    ],
    prior: Annotated[
        str | None,
        typer.Option(help="The imperfect simulator: an MJCF file or package.module:factory. Not for built-in systems."),
    ] = None,
    method: Annotated[str, typer.Option(help=f"How experiments are chosen: {', '.join(METHODS)}.")] = "discrepancy",
    episodes: Episodes = 30,
    steps: Steps = 10,
    horizon: Horizon = 10,
    seed: Seed = 0,
    out: Out = Path("explore-out"),
    resume: Resume = False,
) -> None:
    """Learn a system by choosing its experiments, with an imperfect simulator as the prior.

    Writes metrics.csv (one row an episode), summary.json, the three figures as PNG and SVG, and a checkpoint that
    --resume continues from.

    Example: torch-activegp explore pendulum --episodes 10 --out runs/first
    """
    if method not in METHODS:
        raise ConfigurationError(f"Unknown method {method!r}. Choose from: {', '.join(METHODS)}.")
    budget = Budget(episodes=episodes, episode_length=steps, planning_horizon=horizon)
    task = load_task(system, prior)
    settings = {"command": "explore", "system": system, "prior": prior, "method": method, "seed": seed}
    trial = Trial(method, seed)
    loop = make_loop(task, method, seed, budget, checkpoint=trial.checkpoint(out))
    open_output(out, {**settings, "steps": steps, "horizon": horizon}, resume=resume)
    if resume and trial.checkpoint(out).exists():
        loop.resume()
        console.print(f"Resumed after {len(loop.records)} episodes.")
    with progress_bar(console, "episodes") as progress:
        bar = progress.add_task(f"exploring {task.name}", total=episodes, completed=len(loop.records))
        for record in loop.run(episodes):
            progress.console.print(str(record), highlight=False)
            progress.advance(bar)
    table = records_table([(trial, loop.records)], [method])
    write_table(out / "metrics.csv", table)
    draw_figures(table, out, f"{task.name}: {METHODS[method].title}")
    last = loop.records[-1]
    guard = loop.guard.report()
    write_json(
        out / "summary.json",
        {
            **settings,
            "episodes": len(loop.records),
            "num_points": last.num_points,
            **last.metrics,
            "prior_mse": loop.evaluate.prior_mse,
            "guard": {"stepped_in": guard.stepped_in, "trust": guard.trust.tolist(), "message": str(guard)},
            "seconds": round(sum(record.seconds for record in loop.records), 2),
        },
    )
    console.print(
        f"{last.num_points} transitions brought the error from {loop.evaluate.prior_mse:.3g} (simulator alone) to "
        f"{last.metrics['mse']:.3g}. {guard}\nSee {out / 'figures.png'}.",
        highlight=False,
        soft_wrap=True,
    )
