"""Many trials side by side: methods x seeds, in several processes, resumable."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pandas as pd

from torch_activegp.errors import ActiveGPError
from torch_activegp.experiments.methods import Budget, make_loop
from torch_activegp.experiments.spread import spread
from torch_activegp.experiments.task import Task
from torch_activegp.experiments.user_simulator import name_of
from torch_activegp.experiments.workers import Tell
from torch_activegp.loops import EpisodeRecord

METRICS = ("max_variance", "mse", "discrepancy")
COLUMNS = ("method", "trial", "episode", "num_points", *METRICS)
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

    def __str__(self) -> str:
        """Words for messages."""
        return f"method {self.method}, seed {self.seed}"


@dataclass(frozen=True)
class Step:
    """One episode of a study.

    Attributes:
        trial: the trial that it belongs to.
        record: what it achieved.
        restored: whether it comes from an earlier run's checkpoint.
    """

    trial: Trial
    record: EpisodeRecord
    restored: bool


def run_trial(make_task: Callable[[], Task], budget: Budget, folder: Path, trial: Trial) -> Iterator[Step]:
    """Run or finish one trial.

    Args:
        make_task: makes the task (in a worker process: there).
        budget: length and planner settings.
        folder: for the checkpoint.
        trial: method and seed.

    Yields:
        Every episode, first those of the checkpoint.

    Raises:
        ActiveGPError: whatever stops the trial; names task, method and seed.
    """
    task = make_task()
    with naming(task, trial):
        loop = make_loop(task, trial.method, trial.seed, budget, checkpoint=trial.checkpoint(folder))
        if trial.checkpoint(folder).exists():
            loop.resume()
        yield from (Step(trial, record, True) for record in list(loop.records))
        for record in loop.run(budget.episodes):
            yield Step(trial, record, False)


@contextmanager
def naming(task: Task, trial: Trial) -> Iterator[None]:
    """Put task, simulator, method and seed in front of the message of an error."""
    try:
        yield
    except ActiveGPError as error:
        raise type(error)(f"{task.name} (imperfect simulator: {name_of(task.prior)}), {trial}: {error}") from error


def run_study(
    make_task: Callable[[], Task],
    trials: Sequence[Trial],
    budget: Budget,
    folder: Path,
    *,
    num_jobs: int = 1,
    on_step: Callable[[Step], None] = lambda _: None,
) -> dict[Trial, list[EpisodeRecord]]:
    """Run all trials; what is complete in ``folder`` costs nothing.

    The results do not depend on ``num_jobs``.

    Args:
        make_task: makes the task; can be pickled if ``num_jobs`` is not 1.
        trials: what to run, in this order.
        budget: length and planner settings.
        folder: for the checkpoints.
        num_jobs: processes; 0: one for each core.
        on_step: called with each episode, as it finishes; in a thread if ``num_jobs`` is not 1.

    Returns:
        The records of each trial.

    Raises:
        ActiveGPError: a trial failed, or a process was killed.
    """
    work = partial(_records, make_task, budget, folder)
    found = dict(spread(work, {str(trial): trial for trial in trials}, num_jobs, tell=on_step))
    return {trial: found[str(trial)] for trial in trials}


def _records(
    make_task: Callable[[], Task], budget: Budget, folder: Path, name: str, trial: Trial, tell: Tell
) -> list[EpisodeRecord]:
    """The records of a trial, each told when it is there."""
    records = []
    for step in run_trial(make_task, budget, folder, trial):
        tell(step)
        records.append(step.record)
    return records


def make_trials(methods: Sequence[str], num_trials: int, first_seed: int = 0) -> list[Trial]:
    """Trials of several methods: trial ``i`` of each has the seed ``first_seed + i``; all first trials come first."""
    return [Trial(method, first_seed + index) for index in range(num_trials) for method in methods]


def records_table(results: Mapping[Trial, Sequence[EpisodeRecord]], methods: Sequence[str]) -> pd.DataFrame:
    """One row for each episode, ordered by method and trial; the same for the same seeds (it holds no times).

    Args:
        results: the records of each trial.
        methods: the order of the methods.
    """
    rows = [
        (trial.method, trial.seed, record.index, record.num_points, *(record.metrics[name] for name in METRICS))
        for trial, records in sorted(results.items(), key=lambda item: (methods.index(item[0].method), item[0].seed))
        for record in records
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))
