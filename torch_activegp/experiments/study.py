"""Many trials side by side: methods x seeds, on all cores, resumable."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import joblib
import pandas as pd
import torch

from torch_activegp.experiments.methods import Budget, make_loop
from torch_activegp.experiments.task import Task
from torch_activegp.loops import EpisodeRecord

COLUMNS = ("method", "trial", "episode", "num_points", "max_variance", "mse", "discrepancy")
"""The columns of ``metrics.csv``: one row for each episode of each trial."""


@dataclass(frozen=True)
class Trial:
    """One trial of one method.

    Attributes:
        method: a key of :data:`~torch_activegp.experiments.METHODS`.
        seed: of all its random draws.
    """

    method: str
    seed: int

    def checkpoint(self, folder: Path) -> Path:
        """Where the trial keeps its state."""
        return folder / f"{self.method}-{self.seed}.pt"


def run_trial(make_task: Callable[[], Task], trial: Trial, budget: Budget, folder: Path) -> list[EpisodeRecord]:
    """Run or finish one trial on one core.

    Args:
        make_task: makes the task (it is called in the worker process).
        trial: method and seed.
        budget: length and planner settings.
        folder: for the checkpoint.

    Returns:
        One record an episode.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        loop = make_loop(make_task(), trial.method, trial.seed, budget, checkpoint=trial.checkpoint(folder))
        if trial.checkpoint(folder).exists():
            loop.resume()
        for _ in loop.run(budget.episodes):
            pass
        return loop.records
    finally:
        torch.set_num_threads(threads)


def run_study(
    make_task: Callable[[], Task],
    methods: Sequence[str],
    num_trials: int,
    budget: Budget,
    folder: Path,
    *,
    first_seed: int = 0,
    num_jobs: int = -1,
) -> Iterator[tuple[Trial, list[EpisodeRecord]]]:
    """Run all trials; those that are complete in ``folder`` cost nothing.

    Args:
        make_task: makes the task.
        methods: keys of :data:`~torch_activegp.experiments.METHODS`.
        num_trials: trials of each method; trial ``i`` of every method has the seed ``first_seed + i``.
        budget: length and planner settings.
        folder: for the checkpoints.
        first_seed: seed of the first trial.
        num_jobs: processes; -1 for one a core.

    Yields:
        Each trial with its records, as it finishes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    trials = [Trial(method, first_seed + i) for i in range(num_trials) for method in methods]
    with joblib.Parallel(n_jobs=num_jobs, return_as="generator_unordered") as parallel:
        yield from parallel(joblib.delayed(_labelled)(make_task, trial, budget, folder) for trial in trials)


def _labelled(
    make_task: Callable[[], Task], trial: Trial, budget: Budget, folder: Path
) -> tuple[Trial, list[EpisodeRecord]]:
    return trial, run_trial(make_task, trial, budget, folder)


def records_table(results: Sequence[tuple[Trial, list[EpisodeRecord]]], methods: Sequence[str]) -> pd.DataFrame:
    """One row for each episode, ordered by method and trial; the same for the same seeds (it holds no times).

    Args:
        results: what :func:`run_study` yielded, in any order.
        methods: the order of the methods.
    """
    rows = [
        (trial.method, trial.seed, record.index, record.num_points, *(record.metrics[name] for name in COLUMNS[4:]))
        for trial, records in sorted(results, key=lambda item: (methods.index(item[0].method), item[0].seed))
        for record in records
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))
