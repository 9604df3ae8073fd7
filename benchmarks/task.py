"""The task of the benchmarks: the paper's pendulum, a GP over it with any number of points, and rival planners."""

from __future__ import annotations

from dataclasses import dataclass

import gpytorch
import torch
from tensordict import TensorDict, TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from torch_activegp import keys
from torch_activegp.acquisition import prior_discrepancy
from torch_activegp.envs import GPEnv
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, InverseSquareNoise, NoiseSchedule
from torch_activegp.planners import ICEMPlanner, Sampling
from torch_activegp.simulators import Pendulum

HORIZON, ITERATIONS, CANDIDATES, ELITES, KEPT = 10, 10, 50, 10, 5
TRUTH = Pendulum()


def pendulum_gp(noise: NoiseSchedule | None = None) -> DynamicsGP:
    """The paper's model: the wrong pendulum as mean, unit length-scale and signal variance, noise 1/n^2."""
    mean = EpisodicMean(SimulatorMean(Pendulum(g=9.0, m=0.5, l=2.0)))
    gp = DynamicsGP(mean, gpytorch.kernels.RBFKernel(), noise=noise or InverseSquareNoise())
    gp.covar_module.lengthscale = 1.0
    return gp


def uniform_transitions(count: int, generator: torch.Generator) -> tuple[Tensor, Tensor, Tensor]:
    """States, actions and next states, drawn uniformly within the bounds."""
    state, action = TRUTH.state_space.sample((count,), generator), TRUTH.action_space.sample((count,), generator)
    return state, action, TRUTH.step(state, action)


def start(generator: torch.Generator) -> TensorDict:
    """A state to plan from."""
    return TensorDict({keys.STATE: TRUTH.state_space.sample((), generator)}, batch_size=[])


def icem(env: GPEnv, seed: int = 0) -> ICEMPlanner:
    """The paper's planner, without decay: all planners try the same number of candidates."""
    return ICEMPlanner(
        env,
        planning_horizon=HORIZON,
        optim_steps=ITERATIONS,
        num_candidates=CANDIDATES,
        top_k=ELITES,
        num_kept=KEPT,
        sampling=Sampling(decay=1.0),
        generator=torch.Generator().manual_seed(seed),
    )


@dataclass(frozen=True)
class Prediction:
    """How gpytorch predicts: with ``fast_pred_var`` or without, always by Cholesky factors and never by iteration."""

    fast: bool

    def __call__(self, gp: gpytorch.models.ExactGP, z: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and variance at ``z`` ``(n', D)``, each ``(n', d)``; gpytorch's caches live on between calls."""
        with (
            torch.no_grad(),
            gpytorch.settings.fast_pred_var(self.fast),
            gpytorch.settings.max_cholesky_size(10_000),
            gpytorch.settings.max_root_decomposition_size(10_000),
        ):
            posterior = gp(z)
            return posterior.mean.mT, posterior.variance.mT


class GpytorchEnv(GPEnv):
    """The same environment, with gpytorch's own prediction at each step of the roll-out.

    Args:
        gp: the model.
        score: acquisition function of the posterior's ``loc``, ``scale`` and ``prior_loc``.
        predict: how gpytorch predicts.
    """

    def __init__(self, gp: DynamicsGP, score: TensorDictModuleBase, predict: Prediction) -> None:
        super().__init__(gp, score)
        self.score = score
        self.predict = predict

    @torch.no_grad()
    def imagine(self, tensordict: TensorDictBase, actions: Tensor) -> Tensor:
        """Rewards ``(C, H)`` of candidates ``(C, H, m)`` from one state."""
        gp, space = self.gp, self.gp.state_space
        state = tensordict.get(keys.STATE).expand(actions.shape[0], -1)
        rewards = []
        for action in actions.unbind(-2):
            z = torch.cat([state, action], dim=-1)
            loc, variance = self.predict(gp, z)
            prior_loc = gp.mean_module(z).mT
            points = {keys.LOC: loc, keys.SCALE: variance.clamp_min(0.0).sqrt(), keys.PRIOR_LOC: prior_loc}
            scored = self.score(TensorDict(points, batch_size=z.shape[:1]))
            rewards.append(scored.get(self.score.out_keys[-1]))
            state = space.wrap(loc).clamp(space.low, space.high)
        return torch.cat(rewards, dim=-1)


def environments(gp: DynamicsGP) -> dict[str, GPEnv]:
    """Ours and gpytorch's prediction, without and with ``fast_pred_var``, under the paper's acquisition function."""
    return {
        "ours": GPEnv(gp, prior_discrepancy()),
        "gpytorch": GpytorchEnv(gp, prior_discrepancy(), Prediction(fast=False)),
        "gpytorch, fast_pred_var": GpytorchEnv(gp, prior_discrepancy(), Prediction(fast=True)),
    }
