"""Each episode as a held-out test of the model that it starts with."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import torch
from torch import Tensor

from torch_activegp.collectors.episode_start import state_space_of
from torch_activegp.errors import ConfigurationError
from torch_activegp.models import DynamicsGP, GuardReport, HeldOutGuard
from torch_activegp.models.cached_posterior import CachedPosterior

_FEWEST_TESTS = 3
"""Episodes that must have been tested before a correction is trusted: the spread of fewer says nothing."""


class HeldOutEpisodes:
    """How model and simulator did on the last episodes, each predicted by the model of its first moment.

    Within an episode the model has just learned from the neighbouring state, so steps that are predicted as they come
    make it look better than it is on a trajectory that it has not seen.

    Args:
        gp: the model.
        num_episodes: how many of the last episodes count.

    Attributes:
        sums: of each counted episode, the sums that :class:`~torch_activegp.models.HeldOutGuard` keeps, ``(4, d)``.

    Example:
        >>> import gpytorch
        >>> from torch_activegp.means import SimulatorMean
        >>> from torch_activegp.simulators import Pendulum
        >>> held_out = HeldOutEpisodes(DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel()))
        >>> held_out.trust()
        tensor([0., 0.], dtype=torch.float64)
    """

    def __init__(self, gp: DynamicsGP, num_episodes: int = 10) -> None:
        self.gp = gp
        self.num_episodes = num_episodes
        self.sums: list[Tensor] = []
        self._posterior: CachedPosterior | None = None

    def begin(self) -> None:
        """Keep the model of this moment for the test."""
        self._posterior = copy(self.gp.posterior)  # an append rebinds what the mean is made of

    @torch.no_grad()
    def end(self, state: Tensor, action: Tensor, next_state: Tensor) -> None:
        """Test the kept model on an episode: states ``(T, d)``, actions ``(T, m)``, next states ``(T, d)``.

        Raises:
            ConfigurationError: no model was kept.
        """
        if self._posterior is None:
            raise ConfigurationError("HeldOutEpisodes.end: no model was kept. Call begin() before each episode.")
        space = state_space_of(self.gp)
        features = self._posterior.features(torch.cat([state, action], dim=-1).to(self.gp.output_scale))
        base = features.simulator_loc
        guard = HeldOutGuard(space.dim)
        guard.observe(base, self._posterior.loc(features), space.unwrap(next_state.to(base), base))
        self.sums = [*self.sums, guard.sums][-self.num_episodes :]

    def report(self) -> GuardReport:
        """Errors over all counted episodes, and how much of the correction to trust (:meth:`trust`)."""
        space = state_space_of(self.gp)
        guard = HeldOutGuard(space.dim, space.names)
        for part in self.sums:
            guard.sums += part
        report, trust = guard.report(), self.trust()
        kept = torch.where(trust > 0, report.model_rmse, report.simulator_rmse)
        return replace(report, guarded_rmse=kept, trust=trust)

    def trust(self) -> Tensor:
        """The factor on the learned correction, ``(d,)``: 1 where these episodes show that it pays, else 0.

        It pays where its mean gain over the simulator, in squared error per episode, exceeds the standard error of
        that mean: then a few lucky episodes do not carry it. Only episodes that began with something learned are
        tests. Before the third of them nothing is trusted: the simulator alone is never worse than itself.
        """
        tested = [part for part in self.sums if bool(part[2].any())]
        if len(tested) < _FEWEST_TESTS:
            return torch.zeros(state_space_of(self.gp).dim, dtype=torch.float64)
        _, product, correction, _ = torch.stack(tested).unbind(1)
        gain = 2 * product - correction
        spread = gain.std(0, correction=1) / len(tested) ** 0.5
        untouched = correction.sum(0) == 0
        return ((gain.mean(0) > spread) | untouched).double()
