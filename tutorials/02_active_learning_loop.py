"""
Let the model choose its experiments
====================================

The paper's loop: start where the model knows least, plan the actions that teach most, learn after every step, and make
what was learned the prior of the next episode. Every piece is a module of its own that works in any TorchRL pipeline.

Reference: Miller, Thorpe, Topcu, *Active Learning of Dynamics Using Prior Domain Knowledge in the Sampling Process*,
arXiv 2403.17233.
"""

# %%
# The model
# ---------
# The paper's printed settings: kernel exp(-0.5 |z - z'|^2), noise variance 1 / n^2.

import torch
from gpytorch.kernels import RBFKernel
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.envs.utils import check_env_specs

from torch_activegp.acquisition import Box, Discrepancy, SafeSet, Spread, WeightedSum
from torch_activegp.collectors import LargestScoreStart
from torch_activegp.envs import GPEnv, SimulatorEnv
from torch_activegp.loops import ActiveLearning
from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, InverseSquareNoise
from torch_activegp.planners import ICEMPlanner
from torch_activegp.simulators import Pendulum

truth, simulator = Pendulum(), Pendulum(g=9.0, m=0.5, l=2.0)
gp = DynamicsGP(EpisodicMean(SimulatorMean(simulator)), RBFKernel(), noise=InverseSquareNoise())
gp.covar_module.lengthscale = 1.0

# %%
# What an experiment is worth
# ---------------------------
# Acquisition functions are TensorDict modules that read the posterior under keys such as ``"loc"``, ``"prior_loc"`` and
# ``"scale"``. The paper adds the discrepancy between the model and the episode's prior, the model's uncertainty, and
# side information: here, that the pendulum must not swing further than 2.5 rad, where there is a wall. (The paper's
# penalty is infinite. With a wrong model no plan may be safe; a finite one still finds the least unsafe.)

wall = SafeSet(Box([-2.5, -8.0], [2.5, 8.0]), penalty=100.0)
score = WeightedSum([Discrepancy(), Spread(), wall], weights=[1.0, 1.0, 1.0])

# %%
# Plan in the model, act in the world
# -----------------------------------
# ``GPEnv`` is a TorchRL ``ModelBasedEnvBase`` whose reward is the score; ``ICEMPlanner`` is a TorchRL planner that can
# plan in any other environment too. ``SimulatorEnv`` plays the real pendulum; ``MujocoGymEnv`` wraps Gymnasium's.

model_env = GPEnv(gp, score)
real_env = SimulatorEnv(truth)
check_env_specs(model_env)
planner = ICEMPlanner(
    model_env,
    planning_horizon=10,
    optim_steps=10,
    num_candidates=50,
    top_k=10,
    num_kept=5,
    generator=torch.Generator().manual_seed(0),
)

# %%
# Each episode starts at the state of largest variance, here among those from which the wall can be avoided.

slow = SafeSet(Box([-2.0, -2.0], [2.0, 2.0]), in_keys=["state"])
start = LargestScoreStart(gp, truth.action_space, score=WeightedSum([Spread(), slow]))
buffer = TensorDictReplayBuffer(storage=LazyTensorStorage(1000))
loop = ActiveLearning(real_env, planner, gp, episode_length=10, start=start, replay_buffer=buffer)

# %%
# You own the loop
# ----------------
# One record an episode. With ``checkpoint="run.pt"`` the loop saves itself after each, and ``loop.resume()`` goes on
# bit for bit, also after a kill.

generator = torch.Generator().manual_seed(1)
state = torch.rand(2000, 2, generator=generator, dtype=torch.float64) * 4.0 - 2.0
action = truth.action_space.sample((2000,), generator)


def error() -> float:
    """Mean squared one-step error of what was learned, at random states like the starts."""
    with torch.no_grad():
        return truth.state_space.difference(loop.model(state, action), truth(state, action)).square().mean().item()


errors = [error()]
for episode in loop.run(num_episodes=10):
    errors.append(error())
    print(episode, f"error {errors[-1]:.4f}")

# %%
# What was learned is a simulator again
# -------------------------------------
# ``loop.model`` steps like any simulator, so it can be the mean of the next GP. ``loop.guard`` tests each episode on
# the model that the episode started with, and leaves out corrections that do not beat the simulator alone.

print(loop.guard.report())
swing = {
    name: system.rollout(torch.tensor([0.5, 0.0]), torch.zeros(20, 1))[-1, 0].item()
    for name, system in {"true": truth, "learned": loop.model, "simulator": simulator}.items()
}
print("angle after one second, rad: " + ", ".join(f"{name} {angle:.3f}" for name, angle in swing.items()))

# %%
# What we claimed
# ---------------

assert len(buffer) == gp.num_points == 100
assert errors[-1] < 0.5 * errors[0]
assert abs(swing["learned"] - swing["true"]) < abs(swing["simulator"] - swing["true"])
assert buffer[:]["next", "state"][:, 0].abs().max() < 2.6
