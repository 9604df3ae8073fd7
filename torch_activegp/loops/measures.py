"""The figures of an episode's record."""

from __future__ import annotations

import torch
from torch import Tensor

from torch_activegp.collectors.episode_start import state_space_of
from torch_activegp.models import DynamicsGP
from torch_activegp.simulators import ActionSpace


def probe_points(gp: DynamicsGP, action_space: ActionSpace, num_points: int = 1024) -> Tensor:
    """A fixed Sobol set over the box of states and actions; without bounds, the points visited so far."""
    space = state_space_of(gp)
    low, high = torch.cat([space.low, action_space.low]), torch.cat([space.high, action_space.high])
    if not bool(torch.isfinite(high - low).all()):
        return gp.inputs
    sobol = torch.quasirandom.SobolEngine(len(low)).draw(num_points, dtype=torch.float64)
    return torch.lerp(low, high, sobol.to(low))


@torch.no_grad()
def largest_variance(gp: DynamicsGP, z: Tensor) -> float:
    """The largest posterior variance at points ``(n, D)`` and over the outputs, over the squared output scale."""
    posterior = gp.posterior
    return (posterior.variance(posterior.features(z)) / gp.output_scale.square()).max().item()


@torch.no_grad()
def mean_discrepancy(gp: DynamicsGP, state: Tensor, action: Tensor, next_state: Tensor) -> float:
    """Mean of |p0 - f| over transitions ``(n, d)``, ``(n, m)``, ``(n, d)``, Euclidean, angles on the circle."""
    z = torch.cat([state, action], dim=-1).to(gp.output_scale)
    error = state_space_of(gp).difference(next_state.to(z), gp.posterior.simulator_loc(z))
    return torch.linalg.vector_norm(error, dim=-1).mean().item()
