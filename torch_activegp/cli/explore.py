"""``torch-activegp explore``: one active-learning run."""

from __future__ import annotations

from typing import Annotated

import typer

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
from torch_activegp.cli.progress import EpisodeProgress
from torch_activegp.cli.tasks import check_methods, load_task
from torch_activegp.experiments import (
    METHODS,
    Budget,
    GridEvaluation,
    Task,
    Trial,
    draw_figures,
    make_loop,
    records_table,
)
from torch_activegp.experiments.output import check_output, open_output, write_json, write_table
from torch_activegp.experiments.study import naming
from torch_activegp.experiments.workers import one_thread
from torch_activegp.loops import ActiveLearning


@app.command()
def explore(
    system: System = "pendulum",
    prior: Prior = None,
    method: Annotated[str, typer.Option(help=f"How experiments are chosen: {', '.join(METHODS)}.")] = "directed",
    episodes: Episodes = 30,
    steps: Steps = 10,
    horizon: Horizon = 10,
    seed: Seed = 0,
    bounds: BoundsOption = None,
    out: Out = None,
    resume: Resume = False,
) -> None:
    """Learn a system by choosing its experiments, with an imperfect simulator as the prior.

    Each episode starts where most can be learned and follows the plan that teaches most; what was learned is the prior
    of the next episode.

    Example:  `torch-activegp explore pendulum --episodes 10 --out runs/first`

    Your own:  `torch-activegp explore true.xml --prior imperfect.xml --bounds qvel=-5:5`

    Writes metrics.csv (one row an episode), summary.json, figures.png and .svg (and each figure alone), settings.json,
    and a checkpoint that --resume goes on from. Errors are one-step errors at points all over the state space.
    """
    settings = {
        "command": "explore",
        "system": system,
        "prior": prior,
        "bounds": parse_bounds(bounds),
        "method": check_methods([method])[0],
        "seed": seed,
        "steps": steps,
        "horizon": horizon,
        "episodes": episodes,
    }
    folder = output_folder(out, "explore", system)
    check_output(folder, settings, resume=resume)
    task = load_task(system, prior, parse_bounds(bounds))
    prior_mse = GridEvaluation(task).prior_mse
    trial = Trial(method, seed)
    budget = Budget(episodes=episodes, episode_length=steps, planning_horizon=horizon)
    with one_thread():
        with naming(task, trial):
            loop = make_loop(task, method, seed, budget, checkpoint=trial.checkpoint(folder))
        open_output(folder, settings, resume=resume)
        with naming(task, trial), interruptible(folder):
            if trial.checkpoint(folder).exists():
                console.print(f"Resumed after episode {loop.resume()}.", highlight=False)
            _run(loop, task, episodes)
    table = records_table({trial: loop.records}, [method])
    write_table(folder / "metrics.csv", table)
    draw_figures(table, folder, f"{task.name}: {METHODS[method].title}", unit=task.unit, prior_mse=prior_mse)
    last, guard = loop.records[-1], loop.guard.report()
    summary = {
        **settings,
        "num_points": last.num_points,
        **last.metrics,
        "prior_mse": prior_mse,
        "guard": {"stepped_in": guard.stepped_in, "trust": guard.trust.tolist(), "message": str(guard)},
        "seconds": round(sum(record.seconds for record in loop.records), 2),
    }
    write_json(folder / "summary.json", summary)
    results.print(
        f"{last.num_points} transitions brought the mean squared error from {prior_mse:.3g} (simulator alone) to "
        f"{last.metrics['mse']:.3g}. {guard}\nSee {folder / 'figures.png'}.",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )


def _run(loop: ActiveLearning, task: Task, episodes: int) -> None:
    console.print(
        f"{task.name}: {task.description}" if task.description else task.name, highlight=False, soft_wrap=True
    )
    with EpisodeProgress(console, "exploring", episodes) as progress:
        for _ in loop.records:
            progress.advance(restored=True)
        for record in loop.run(episodes):
            results.print(str(record), highlight=False, markup=False, soft_wrap=True)
            progress.advance()
