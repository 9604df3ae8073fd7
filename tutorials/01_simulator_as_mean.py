"""
A simulator as the mean of a Gaussian process
=============================================

You have a simulator of a pendulum. It is wrong: too light, too long. This tutorial makes it the mean function of a
Gaussian process over the one-step dynamics, so that ten measurements are enough to correct it where they were taken,
and far from them the simulator still speaks.
"""

# %%
# The real pendulum and the imperfect simulator
# ---------------------------------------------
# A simulator is any batched map from (state, action) to the next state. Your own torch function fits as
# ``FunctionSimulator(function, ...)``, an MJCF file as ``MujocoSimulator("model.xml")``.

import torch
from gpytorch.kernels import MaternKernel, RBFKernel
from gpytorch.means import ZeroMean

from torch_activegp.means import EpisodicMean, SimulatorMean
from torch_activegp.models import DynamicsGP, FixedNoise, fit_hyperparameters, scaled_rbf
from torch_activegp.simulators import Pendulum

truth = Pendulum(g=9.81, m=1.0, l=1.0)
simulator = Pendulum(g=9.0, m=0.5, l=2.0)
generator = torch.Generator().manual_seed(0)


def sample(count: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Transitions of the real pendulum from random states under random torques."""
    state = truth.state_space.sample((count,), generator)
    action = truth.action_space.sample((count,), generator)
    return state, action, truth(state, action)


# %%
# Mean, kernel, noise: injected
# -----------------------------
# ``DynamicsGP`` is a gpytorch ``ExactGP`` with one output for each state. The mean can be any gpytorch mean, the kernel
# any gpytorch kernel. Angles wrap: residuals are taken on the circle; the simulator says which states are angles.

with_simulator = DynamicsGP(EpisodicMean(SimulatorMean(simulator)), RBFKernel(), noise=FixedNoise(1e-4))
without = DynamicsGP(
    ZeroMean(batch_shape=torch.Size([2])), RBFKernel(), noise=FixedNoise(1e-4), state_space=truth.state_space
)
data = sample(10)
with_simulator.update(*data)
without.update(*data)

# %%
# What ten points are worth
# -------------------------
# ``gp(z)`` is gpytorch's own posterior. ``gp.posterior`` is the same one, cached: hundreds of times faster to query,
# and a new point is appended to its Cholesky factor instead of factoring again.

test_state, test_action, test_next = sample(2000)
z = torch.cat([test_state, test_action], dim=-1)


def error(gp: DynamicsGP) -> float:
    """Mean squared one-step error on the test points, angles on the circle."""
    posterior = gp.posterior
    with torch.no_grad():
        loc = posterior.loc(posterior.features(z))
    return truth.state_space.difference(loc, test_next).square().mean().item()


simulator_alone = truth.state_space.difference(simulator(test_state, test_action), test_next).square().mean().item()
print(f"simulator alone            {simulator_alone:.4f}")
print(f"GP, simulator as mean      {error(with_simulator):.4f}")
print(f"GP, zero mean              {error(without):.4f}")

with torch.no_grad():
    gpytorchs_own = with_simulator(z[:100])
cached = with_simulator.posterior.loc(with_simulator.posterior.features(z[:100]))

# %%
# Swap the kernel, fit its hyper-parameters
# -----------------------------------------
# With more data the marginal likelihood finds length-scales for each input. ``scaled_rbf`` comes with priors in the
# units of the state space; a Matern kernel, a sum or a product of kernels works just as well.

low = torch.cat([truth.state_space.low, truth.action_space.low])
high = torch.cat([truth.state_space.high, truth.action_space.high])
hundred = sample(100)
models = {
    "RBF as it comes": DynamicsGP(SimulatorMean(simulator), RBFKernel(), noise=FixedNoise(1e-4)),
    "Matern 5/2, fitted": DynamicsGP(SimulatorMean(simulator), MaternKernel(ard_num_dims=3), noise=FixedNoise(1e-4)),
    "scaled RBF, fitted": DynamicsGP(SimulatorMean(simulator), scaled_rbf(low, high), noise=FixedNoise(1e-4)),
}
for name, gp in models.items():
    gp.update(*hundred)
    if "fitted" in name:
        fit_hyperparameters(gp)
    print(f"100 points, {name:20} {error(gp):.4f}")

# %%
# What we claimed
# ---------------

assert error(with_simulator) < simulator_alone < error(without)
assert torch.allclose(cached, gpytorchs_own.mean.mT, atol=1e-8)
assert error(models["scaled RBF, fitted"]) < 0.2 * error(models["RBF as it comes"])
