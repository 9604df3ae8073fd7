"""Where an episode starts: at the state from which the most can be learned."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from tensordict.nn import TensorDictModuleBase
from torch import Tensor
from torch.quasirandom import SobolEngine

from torch_activegp import keys
from torch_activegp.acquisition import Spread
from torch_activegp.collectors.episode_start import EpisodeStart
from torch_activegp.errors import ConfigurationError, PlanningError
from torch_activegp.models import DynamicsGP, PosteriorModule
from torch_activegp.simulators import ActionSpace

_TRIALS = 16
"""Points tried around each refined point in each round."""


class LargestScoreStart(EpisodeStart):
    """The state of the point (x, u) with the largest score; by default the largest variance, as in the paper.

    A scrambled Sobol set over states and actions is scored; the best points are then refined by local random search
    with shrinking steps. A fresh set is drawn for each call, so that ties (all variances are equal before the first
    data) are broken by chance. The generator is part of the ``state_dict``; the model is not.

    Args:
        gp: the model; its state space must be bounded.
        action_space: bounds of the actions.
        score: acquisition function; default :class:`~torch_activegp.acquisition.Spread` in the GP's output scale.
        num_candidates: size of the Sobol set.
        num_refined: how many of the best points are refined.
        num_rounds: rounds of refinement; the step halves in each, from a twentieth of the range.
        seed: of the Sobol set and of the refinement.

    Raises:
        ConfigurationError: the GP has no state space, a bound is infinite, or a number is out of range.

    Example:
        >>> import gpytorch
        >>> from torch_activegp.means import SimulatorMean
        >>> from torch_activegp.simulators import Pendulum
        >>> gp = DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel())
        >>> LargestScoreStart(gp, Pendulum().action_space)().shape
        torch.Size([2])

    Reference: Miller et al. 2024 (arXiv 2403.17233), algorithm 1.
    """

    def __init__(
        self,
        gp: DynamicsGP,
        action_space: ActionSpace,
        *,
        score: TensorDictModuleBase | None = None,
        num_candidates: int = 1024,
        num_refined: int = 8,
        num_rounds: int = 4,
        seed: int = 0,
    ) -> None:
        super().__init__(gp, action_space, seed)
        for name, value in (("num_candidates", num_candidates), ("num_refined", num_refined)):
            if value < 1:
                raise ConfigurationError(f"LargestScoreStart: wanted {name} >= 1, found {value}.")
        if num_rounds < 0:
            raise ConfigurationError(f"LargestScoreStart: wanted num_rounds >= 0, found {num_rounds}.")
        self.score = score
        self.num_candidates = num_candidates
        self.num_refined = min(num_refined, num_candidates)
        self.num_rounds = num_rounds

    @torch.no_grad()
    def forward(self) -> Tensor:
        """Choose a start state, ``(d,)``.

        Raises:
            PlanningError: no point has a finite score.
        """
        seed = int(torch.randint(2**31, (), generator=self.generator))
        sobol = SobolEngine(len(self.low), scramble=True, seed=seed).draw(self.num_candidates, dtype=torch.float64)
        points = self._wrap(torch.lerp(self.low, self.high, sobol.to(self.low)))
        values, best = self.evaluate(points).topk(self.num_refined)
        points = points[best]
        step = (self.high - self.low) / 20
        for _ in range(self.num_rounds):
            points, values = self._refine(points, values, step)
            step = step / 2
        value, best = values.max(dim=0)
        if value == -torch.inf:
            raise PlanningError(
                f"Wanted a state to start from, found no finite score among {self.num_candidates} points in the bounds "
                "of states and actions. Either a safe set excludes them all, or the simulator or the score returned "
                "NaN or infinity there. Check both, widen the safe set or raise num_candidates."
            )
        return points[best, : self.state_space.dim]

    def evaluate(self, points: Tensor) -> Tensor:
        """The score at points z ``(n, d + m)``: ``(n,)``; -inf, so never chosen, where it is NaN or infinite."""
        d = self.state_space.dim
        score = Spread(self.gp.output_scale) if self.score is None else self.score
        quantities = [key for key in score.in_keys if key in keys.POSTERIOR_KEYS]
        points_td = TensorDict({keys.STATE: points[:, :d], keys.ACTION: points[:, d:]}, points.shape[:1])
        points_td = score(PosteriorModule(self.gp, out_keys=quantities)(points_td))
        value = points_td.get(score.out_keys[-1]).squeeze(-1)
        return value.nan_to_num(nan=-torch.inf, posinf=-torch.inf, neginf=-torch.inf)

    def _refine(self, points: Tensor, values: Tensor, step: Tensor) -> tuple[Tensor, Tensor]:
        shape = (self.num_refined, _TRIALS, len(self.low))
        noise = torch.randn(shape, generator=self.generator, dtype=torch.float64).to(points)
        trial = self._wrap((points.unsqueeze(1) + step * noise).clamp(self.low, self.high))
        scores, best = self.evaluate(trial.flatten(0, 1)).reshape(shape[:2]).max(dim=1)
        better = scores > values
        chosen = trial[torch.arange(self.num_refined), best]
        return torch.where(better.unsqueeze(-1), chosen, points), torch.where(better, scores, values)

    def _wrap(self, points: Tensor) -> Tensor:
        """Normalise quaternions and wrap angles of points ``(..., d + m)``."""
        d = self.state_space.dim
        return torch.cat([self.state_space.wrap(points[..., :d]), points[..., d:]], dim=-1)
