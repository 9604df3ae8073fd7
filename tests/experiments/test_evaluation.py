from __future__ import annotations

import pytest
import torch

from torch_activegp.errors import SimulationError
from torch_activegp.experiments.evaluation import GridEvaluation
from torch_activegp.experiments.methods import Budget, make_loop
from torch_activegp.experiments.task import PRINTED, Task, pendulum
from torch_activegp.simulators import FunctionSimulator, Pendulum

TINY = Budget(episode_length=3, planning_horizon=2, optim_steps=1)


def test_the_papers_pendulum_starts_from_this_error() -> None:
    task = pendulum()
    z, following = task.test_points()
    gap = task.prior(z[:, :2], z[:, 2:]) - following
    gap[:, 0] = torch.atan2(gap[:, 0].sin(), gap[:, 0].cos())
    assert GridEvaluation(task).prior_mse == pytest.approx(gap.square().mean().item(), rel=1e-12)
    assert GridEvaluation(task).prior_mse == pytest.approx(0.1487, abs=1e-4)


@pytest.mark.parametrize("method", ["discrepancy", "opax"])
def test_the_figures_agree_with_gpytorchs_posterior(method: str) -> None:
    whole = pendulum()
    task = Task("small", whole.truth, whole.prior, PRINTED, grid=4)
    loop = make_loop(task, method, 0, TINY)
    before = GridEvaluation(task)
    (record,) = loop.run(1)
    z, following = task.test_points()
    base = loop.gp.mean_module.base(loop.gp.inputs)
    kernel = loop.gp.covar_module
    noisy = kernel(loop.gp.inputs).to_dense() + torch.eye(3) / 9
    cross = kernel(z, loop.gp.inputs).to_dense()
    loc = loop.gp.mean_module.base(z) + cross @ torch.linalg.solve(noisy, loop.gp.targets - base)
    variance = 1 - (cross * torch.linalg.solve(noisy, cross.mT).mT).sum(-1)
    error = task.truth.state_space.difference(loc, following)
    assert record.metrics["mse"] == pytest.approx(error.square().mean().item(), rel=1e-8)
    assert record.metrics["max_variance"] == pytest.approx(variance.max().item(), rel=1e-8)
    episode = loop.episodes[0]
    gap = task.truth.state_space.difference(task.prior(episode["state"], episode["action"]), episode["next", "state"])
    assert record.metrics["discrepancy"] == pytest.approx(gap.norm(dim=-1).mean().item(), rel=1e-12)
    assert before(loop) == record.metrics


def test_an_imperfect_simulator_that_fails_somewhere_is_refused() -> None:
    truth = Pendulum()
    broken = FunctionSimulator(
        lambda state, action: torch.where(state > 7.9, torch.nan, state + 0 * action[..., :1]),
        truth.state_space,
        truth.action_space,
        dt=truth.dt,
    )
    with pytest.raises(SimulationError, match=r"`FunctionSimulator` returned .*nan.*'theta_dot': 8.0"):
        GridEvaluation(Task("broken", truth, broken, PRINTED, grid=3))
