from __future__ import annotations

from pathlib import Path

import pytest
import torch

from torch_activegp.errors import CheckpointError, PlanningError, SimulationError
from torch_activegp.experiments.methods import Budget
from torch_activegp.experiments.study import (
    COLUMNS,
    Step,
    Trial,
    make_trials,
    naming,
    records_table,
    run_study,
    run_trial,
)
from torch_activegp.experiments.task import Task, pendulum
from torch_activegp.experiments.user_simulator import UserSimulator
from torch_activegp.loops import EpisodeRecord
from torch_activegp.simulators import Pendulum

TINY = Budget(episodes=2, episode_length=2, planning_horizon=2, optim_steps=1, num_candidates=12)


def small_pendulum() -> Task:
    whole = pendulum()
    return Task("small", whole.truth, whole.prior, whole.gp, grid=4)


def record(index: int, value: float) -> EpisodeRecord:
    metrics = {"mse": value, "max_variance": value + 1, "discrepancy": value + 2}
    return EpisodeRecord(index, 10 * index, 0.0, 0.0, 9.9, (1.0,), metrics)


def test_first_trials_come_first_and_seeds_count_up() -> None:
    trials = [(trial.method, trial.seed) for trial in make_trials(["a", "b"], 2, first_seed=7)]
    assert trials == [("a", 7), ("b", 7), ("a", 8), ("b", 8)]


def test_the_table_has_the_given_order_whatever_finished_first() -> None:
    results = {Trial("a", 1): [record(1, 3.0)], Trial("b", 0): [record(1, 1.0), record(2, 2.0)]}
    table = records_table(results, ["b", "a"])
    assert tuple(table.columns) == COLUMNS
    assert table.values.tolist() == [
        ["b", 0, 1, 10, 2.0, 1.0, 3.0],
        ["b", 0, 2, 20, 3.0, 2.0, 4.0],
        ["a", 1, 1, 10, 4.0, 3.0, 5.0],
    ]
    assert records_table(dict(reversed(results.items())), ["b", "a"]).equals(table)


def test_a_study_gives_the_same_table_whole_or_cut(tmp_path: Path) -> None:
    methods = ["discrepancy", "sigma"]
    trials = make_trials(methods, 1)
    threads = torch.get_num_threads()

    def cut(step: Step) -> None:
        raise KeyboardInterrupt

    whole = run_study(small_pendulum, trials, TINY, tmp_path / "a")
    with pytest.raises(KeyboardInterrupt):
        run_study(small_pendulum, trials, TINY, tmp_path / "b", on_step=cut)
    assert torch.get_num_threads() == threads
    steps: list[Step] = []
    rest = run_study(small_pendulum, trials, TINY, tmp_path / "b", on_step=steps.append)
    assert [(step.trial.method, step.record.index, step.restored) for step in steps] == [
        ("discrepancy", 1, True),
        ("discrepancy", 2, False),
        ("sigma", 1, False),
        ("sigma", 2, False),
    ]
    assert records_table(rest, methods).to_csv() == records_table(whole, methods).to_csv()
    assert rest == {trial: [step.record for step in steps if step.trial == trial] for trial in trials}


def test_several_processes_give_the_same_records_and_tell_each_step(tmp_path: Path) -> None:
    methods = ["discrepancy", "sigma"]
    trials = make_trials(methods, 1)
    steps: list[Step] = []
    found = run_study(pendulum, trials, TINY, tmp_path / "two", num_jobs=2, on_step=steps.append)
    alone = run_study(pendulum, trials, TINY, tmp_path / "one")
    assert list(found) == trials
    assert records_table(found, methods).equals(records_table(alone, methods))
    assert {trial: [step.record for step in steps if step.trial == trial] for trial in trials} == found


def test_a_damaged_checkpoint_names_the_trial(tmp_path: Path) -> None:
    trial = Trial("sigma", 3)
    trial.checkpoint(tmp_path).write_text("no checkpoint")
    message = r"small \(imperfect simulator: Pendulum\), method sigma, seed 3: .*sigma-3.pt is not a readable"
    with pytest.raises(CheckpointError, match=message):
        list(run_trial(small_pendulum, TINY, tmp_path, trial))


def test_errors_keep_their_class_and_say_where() -> None:
    task = Task("mine:make", Pendulum(), UserSimulator(Pendulum(m=0.5), "mine:wrong"), pendulum().gp)
    for kind in (PlanningError, SimulationError):
        with (
            pytest.raises(kind, match=r"^mine:make \(imperfect simulator: mine:wrong\), method opax, seed 0: lost$"),
            naming(task, Trial("opax", 0)),
        ):
            raise kind("lost")
