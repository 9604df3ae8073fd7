from __future__ import annotations

from pathlib import Path

import pytest
import torch

from torch_activegp.errors import CheckpointError, ConfigurationError
from torch_activegp.experiments.methods import METHODS, PAPER_METHODS, Budget, make_loop
from torch_activegp.experiments.task import FITTED, Task, pendulum
from torch_activegp.loops import ActiveLearning
from torch_activegp.simulators import Pendulum

TINY = Budget(episodes=2, episode_length=3, planning_horizon=3, optim_steps=2, num_candidates=20, top_k=4, num_kept=2)


def small_pendulum() -> Task:
    whole = pendulum()
    return Task("small", whole.truth, whole.prior, whole.gp, grid=5)


def visited(loop: ActiveLearning) -> torch.Tensor:
    return torch.cat([torch.cat([episode["state"], episode["action"]], dim=-1) for episode in loop.episodes])


def test_the_papers_methods_are_there() -> None:
    assert set(PAPER_METHODS) <= set(METHODS)
    assert len({method.title for method in METHODS.values()}) == len(METHODS)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_learns_and_repeats_itself(method: str) -> None:
    loops = [make_loop(small_pendulum(), method, seed, TINY) for seed in (0, 0, 1)]
    for loop in loops:
        records = list(loop.run(TINY.episodes))
        assert [record.num_points for record in records] == [3, 6]
        assert set(records[0].metrics) == {"mse", "max_variance", "discrepancy"}
    assert torch.equal(visited(loops[0]), visited(loops[1]))
    assert not torch.equal(visited(loops[0]), visited(loops[2]))
    actions = visited(loops[0])[:, 2:]
    assert actions.shape == (6, 1)
    assert actions.abs().max() <= 2
    assert METHODS[method].with_prior == (loops[0].records[0].metrics["mse"] < 1)


def test_six_episodes_beat_the_simulator_alone() -> None:
    budget = Budget(episodes=6, planning_horizon=5, optim_steps=3, num_candidates=30)
    loop = make_loop(small_pendulum(), "sigma", 0, budget)
    records = list(loop.run(budget.episodes))
    assert records[-1].metrics["mse"] < loop.evaluate.prior_mse


def test_a_task_with_fitted_settings_is_fitted() -> None:
    task = Task("fitted", Pendulum(), Pendulum(m=0.5), FITTED, grid=5)
    loop = make_loop(task, "discrepancy", 0, TINY)
    before = loop.gp.covar_module.base_kernel.lengthscale.clone()
    list(loop.run(2))
    assert not torch.equal(loop.gp.covar_module.base_kernel.lengthscale, before)


@pytest.mark.parametrize("method", ["discrepancy", "opax", "random"])
def test_a_run_can_be_cut_anywhere(method: str, tmp_path: Path) -> None:
    whole = make_loop(small_pendulum(), method, 0, TINY)
    list(whole.run(2))
    next(iter(make_loop(small_pendulum(), method, 0, TINY, checkpoint=tmp_path / "a.pt").run(1)))
    rest = make_loop(small_pendulum(), method, 0, TINY, checkpoint=tmp_path / "a.pt")
    assert rest.resume() == 1
    list(rest.run(2))
    assert torch.equal(visited(rest), visited(whole))
    assert rest.records[1].metrics == whole.records[1].metrics


def test_a_checkpoint_of_another_horizon_is_refused(tmp_path: Path) -> None:
    next(iter(make_loop(small_pendulum(), "sigma", 0, TINY, checkpoint=tmp_path / "a.pt").run(1)))
    other = Budget(episode_length=3, planning_horizon=4)
    with pytest.raises(CheckpointError, match="horizon"):
        make_loop(small_pendulum(), "sigma", 0, other, checkpoint=tmp_path / "a.pt").resume()


@pytest.mark.parametrize("name", ["episodes", "episode_length", "planning_horizon"])
def test_a_budget_is_positive(name: str) -> None:
    with pytest.raises(ConfigurationError, match=f"{name} >= 1, found 0"):
        Budget(**{name: 0})


def test_an_unknown_method_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="Unknown method 'sgma'. Choose from: discrepancy"):
        make_loop(small_pendulum(), "sgma", 0)
