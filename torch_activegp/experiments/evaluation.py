"""How good a model is on the whole space: the numbers of the paper's figures."""

from __future__ import annotations

import torch

from torch_activegp import keys
from torch_activegp.experiments.task import Task
from torch_activegp.experiments.user_simulator import require_finite
from torch_activegp.loops import ActiveLearning


class GridEvaluation:
    """Evaluate a loop's model on the test points of a task.

    Args:
        task: supplies grid, truth and the imperfect simulator.

    Raises:
        SimulationError: one of the two simulators is not finite on the grid.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.z, self.following = task.test_points()
        state, action = self.z.split([task.prior.state_dim, task.prior.action_dim], dim=-1)
        with torch.no_grad():
            self.prior = task.prior.step(state, action)
        require_finite(task.prior, self.prior, state, action)

    @torch.no_grad()
    def __call__(self, loop: ActiveLearning) -> dict[str, float]:
        """The figures after an episode.

        Returns:
            ``mse``: mean squared one-step error over grid points and states, angles on the circle;
            ``max_variance``: largest posterior variance on the grid over squared output scale;
            ``discrepancy``: mean |p0 - f| at the points that the last episode visited, Euclidean over the states.
        """
        posterior, space = loop.gp.posterior, self.task.truth.state_space
        features = posterior.features(self.z)
        error = space.difference(posterior.loc(features), self.following)
        variance = posterior.variance(features) / loop.gp.output_scale.square()
        return {
            "mse": error.square().mean().item(),
            "max_variance": variance.max().item(),
            "discrepancy": self._discrepancy(loop),
        }

    def _discrepancy(self, loop: ActiveLearning) -> float:
        episode = loop.episodes[-1]
        prior = self.task.prior.step(episode.get(keys.STATE), episode.get(loop.env.action_key))
        gap = self.task.truth.state_space.difference(prior, episode.get(("next", keys.STATE)))
        return torch.linalg.vector_norm(gap, dim=-1).mean().item()

    @property
    def prior_mse(self) -> float:
        """The imperfect simulator's own error on the grid."""
        return self.task.truth.state_space.difference(self.prior, self.following).square().mean().item()
