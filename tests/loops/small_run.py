"""A small active-learning run, in the tests' own process or in one that waits to be killed in the middle of a step.

As a script: ``small_run.py CHECKPOINT WAIT_AT_STEP``.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import gpytorch
import torch
from tensordict.nn import TensorDictModule, TensorDictModuleBase, TensorDictSequential
from torch import Tensor

from torch_activegp import keys
from torch_activegp.acquisition import RandomScore, WeightedSum, prior_discrepancy
from torch_activegp.collectors import LargestScoreStart
from torch_activegp.envs import GPEnv, SimulatorEnv
from torch_activegp.loops import ActiveLearning
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, InverseSquareNoise, NoiseSchedule
from torch_activegp.planners import ICEMPlanner
from torch_activegp.simulators import Pendulum

PLAN = ("plan", "action")


def make_gp(noise: NoiseSchedule | None = None, recursion: str = "paper") -> DynamicsGP:
    """The paper's pendulum with its wrong prior."""
    mean = EpisodicMean(SimulatorMean(Pendulum(g=9.0, m=0.5, l=2.0)), recursion=recursion)
    gp = DynamicsGP(mean, gpytorch.kernels.RBFKernel(ard_num_dims=3), noise=noise or InverseSquareNoise())
    gp.covar_module.lengthscale = torch.tensor([1.0, 4.0, 4.0])
    return gp


def make_loop(
    *,
    seed: int = 0,
    noise: NoiseSchedule | None = None,
    recursion: str = "paper",
    tail: TensorDictModuleBase | None = None,
    episode_length: int = 4,
    **options: Any,
) -> ActiveLearning:
    """Everything that can draw does: start, planner, score, noise of the system."""
    gp = make_gp(noise, recursion)
    chance = torch.Generator().manual_seed(seed + 1)
    score = WeightedSum([*prior_discrepancy().terms, RandomScore(chance)], [1.0, 1.0, 0.1])
    env = GPEnv(gp, score, action_key=PLAN)
    planner = ICEMPlanner(
        env,
        planning_horizon=3,
        optim_steps=2,
        num_candidates=8,
        top_k=3,
        num_kept=2,
        generator=torch.Generator().manual_seed(seed + 2),
    )
    controls = TensorDictModule(lambda plan: plan[..., :1], in_keys=[PLAN], out_keys=[keys.ACTION])
    policy = TensorDictSequential(*[planner, controls, *([] if tail is None else [tail])])
    real = SimulatorEnv(Pendulum(), noise_scale=0.01, seed=seed + 3)
    start = LargestScoreStart(gp, Pendulum().action_space, num_candidates=64, num_rounds=2, seed=seed + 4)
    return ActiveLearning(real, policy, gp, **{"start": start, "episode_length": episode_length, **options})


def outcome(loop: ActiveLearning) -> dict[str, Any]:
    """All that must be the same after an interruption, as plain values."""
    episodes = [
        {str(key): value.tolist() for key, value in episode.items(include_nested=True, leaves_only=True)}
        for episode in loop.episodes
    ]
    z = torch.linspace(-2, 2, 15, dtype=torch.float64).reshape(5, 3)
    with torch.no_grad():
        posterior = loop.gp.posterior
        features = posterior.features(z)
        predicted = [posterior.loc(features), posterior.scale(features), posterior.prior_loc(features)]
    return {
        "records": [{**record.as_dict(), "seconds": 0, "trust": list(record.trust)} for record in loop.records],
        "episodes": episodes,
        "data": [loop.gp.inputs.tolist(), loop.gp.targets.tolist()],
        "predicted": [value.tolist() for value in predicted],
        "guard": [sums.tolist() for sums in loop.guard.sums],
    }


class WaitAt(TensorDictModuleBase):
    """Say so at a certain step, and wait to be killed."""

    def __init__(self, step: int) -> None:
        super().__init__()
        self.in_keys, self.out_keys = [keys.ACTION], [keys.ACTION]
        self.left = step

    def forward(self, tensordict: Tensor) -> Tensor:
        """Count down."""
        self.left -= 1
        if not self.left:
            print("waiting", flush=True)
            time.sleep(600)
        return tensordict


def main(checkpoint: str, wait_at: str) -> None:
    """Run until the process is killed."""
    torch.set_num_threads(1)
    loop = make_loop(checkpoint=checkpoint, settings={"seed": 0}, tail=WaitAt(int(wait_at)))
    for _ in loop.run(1000):
        pass


if __name__ == "__main__":
    main(*sys.argv[1:])
