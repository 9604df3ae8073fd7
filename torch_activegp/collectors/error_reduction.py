"""Where an episode starts: where its points together remove most of the expected error."""

from __future__ import annotations

import torch
from torch import Tensor

from torch_activegp.acquisition.base import root_mean_square
from torch_activegp.collectors.episode_start import EpisodeStart
from torch_activegp.errors import ConfigurationError
from torch_activegp.models import DynamicsGP
from torch_activegp.models.cached_posterior import CachedPosterior, Features
from torch_activegp.simulators import ActionSpace

_JITTER = 1e-8
"""Added to the relative noise, because two points of an episode may coincide."""


class LargestErrorReductionStart(EpisodeStart):
    """The start whose whole episode is expected to reduce the model's weighted error most.

    A point of large variance may lie in a corner and teach little about the rest. This start looks at what an episode
    teaches about the *whole* space: from random states, with a random constant action each, the model's mean is rolled
    out; the variance that the visited points Z' would remove at random reference points r is known in closed form,

        gain(Z') = mean_r w(r) k_n(r, Z') (k_n(Z', Z') + noise)^-1 k_n(Z', r),

    with k_n the posterior covariance. The weight w(r) = (|mu - p0| + sigma)^2, relative to the signal's scale, is the
    squared upper confidence bound of the simulator's error at r: regions where the simulator was seen to be right do
    not count. It needs finite bounds, and one kernel and one noise for all outputs.

    Args:
        gp: the model; its state space must be bounded.
        action_space: bounds of the actions.
        episode_length: steps that are rolled out, N.
        num_starts: random starts that are compared.
        num_references: random points of the space at which the error counts.
        seed: of all draws; they are fresh in each call.

    Raises:
        ConfigurationError: a bound is infinite, or a number is not positive.

    Reference: expected variance reduction after Cohn, Ghahramani, Jordan 1996, *Active Learning with Statistical
    Models* (ALC), here for a whole episode and with weights.
    """

    def __init__(
        self,
        gp: DynamicsGP,
        action_space: ActionSpace,
        *,
        episode_length: int = 10,
        num_starts: int = 800,
        num_references: int = 400,
        seed: int = 0,
    ) -> None:
        super().__init__(gp, action_space, seed)
        numbers = {"episode_length": episode_length, "num_starts": num_starts, "num_references": num_references}
        for name, value in numbers.items():
            if value < 1:
                raise ConfigurationError(f"LargestErrorReductionStart: wanted {name} >= 1, found {value}.")
        self.episode_length = episode_length
        self.num_starts = num_starts
        self.num_references = num_references

    @torch.no_grad()
    def forward(self) -> Tensor:
        """Choose a start state, ``(d,)``.

        Raises:
            ConfigurationError: the outputs do not share kernel and noise.
        """
        posterior = self.gp.posterior
        if posterior.noise.shape[0] != 1:
            raise ConfigurationError(
                "LargestErrorReductionStart wants one kernel and one relative noise for all outputs. Use a kernel "
                "without batch shape, or LargestScoreStart."
            )
        references = posterior.features(self._sample(self.num_references))
        weight = self._weight(posterior, references)
        points = self._sample(self.num_starts)
        gain = self._gain(posterior, self._roll_out(posterior, points), references, weight)
        gain = torch.where(torch.isfinite(gain), gain, -torch.inf)
        return points[gain.argmax(), : self.gp.num_outputs]

    def _sample(self, count: int) -> Tensor:
        unit = torch.rand(count, len(self.low), generator=self.generator, dtype=torch.float64).to(self.low)
        return torch.lerp(self.low, self.high, unit)

    def _weight(self, posterior: CachedPosterior, at: Features) -> Tensor:
        """Squared upper bound of the simulator's relative error at the references, ``(n',)``."""
        scale = posterior.output_scale
        gap = root_mean_square((posterior.loc(at) - at.simulator_loc) / scale)
        return (gap + root_mean_square(posterior.scale(at) / scale)).square().squeeze(-1)

    def _roll_out(self, posterior: CachedPosterior, points: Tensor) -> Features:
        """Features of the points visited from each start, ``(starts * steps, ...)``, starts first."""
        space, d = self.state_space, self.gp.num_outputs
        state, action, visited = points[:, :d], points[:, d:], []
        for _ in range(self.episode_length):
            features = posterior.features(torch.cat([state, action], dim=-1))
            visited.append(features)
            state = space.wrap(posterior.loc(features)).clamp(space.low, space.high)
        z = torch.stack([step.z for step in visited], dim=1).flatten(0, 1)
        cross = torch.stack([step.cross for step in visited], dim=2).flatten(1, 2)
        base, outer = (
            torch.stack([getattr(step, name) for step in visited], 1).flatten(0, 1)
            for name in ("simulator_loc", "outer")
        )
        return Features(z, cross, base, outer)

    def _gain(self, posterior: CachedPosterior, visited: Features, references: Features, weight: Tensor) -> Tensor:
        """Weighted variance that each start's points remove, ``(starts,)``."""
        shape = (self.num_starts, self.episode_length, -1)
        white, white_references = (posterior.factor.whiten(at.cross)[0] for at in (visited, references))
        across = posterior.prior_covariance(visited.z, references.z) - white @ white_references.mT
        points, white = visited.z.reshape(shape), white.reshape(shape)
        within = posterior.prior_covariance(points, points) - white @ white.mT
        noise = posterior.noise + _JITTER
        factor = torch.linalg.cholesky(within + noise * torch.eye(self.episode_length).to(within))
        removed = torch.linalg.solve_triangular(factor, across.reshape(shape), upper=False).square().sum(1)
        return removed @ weight / self.num_references
