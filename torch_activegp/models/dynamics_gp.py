"""The Gaussian process over one-step dynamics: a gpytorch ExactGP for all outputs."""

from __future__ import annotations

from typing import Any

import gpytorch
import torch
from gpytorch.distributions import MultivariateNormal
from gpytorch.kernels import Kernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.means import Mean
from torch import Tensor

from torch_activegp.errors import ConfigurationError, ShapeError, SimulationError
from torch_activegp.means import EpisodicMean, predict_mean
from torch_activegp.models.cached_posterior import CachedPosterior
from torch_activegp.models.fingerprint import Fingerprint
from torch_activegp.models.noise import Count, FixedNoise, LearnedNoise, NoiseSchedule
from torch_activegp.models.training_data import TrainingData, check_transitions
from torch_activegp.simulators import StateSpace


class DynamicsGP(TrainingData, gpytorch.models.ExactGP):
    """A GP over x' = f(x, u) with ``d`` outputs, whose mean is usually an imperfect simulator.

    gpytorch is the definition: called as ``gp(z)`` it is an :class:`~gpytorch.models.ExactGP` of batch shape ``(d,)``,
    and every kernel, mean and likelihood of batch shape ``()`` or ``(d,)`` can be injected. :attr:`posterior` is the
    same posterior, cached, hundreds of times faster to query and to update.

    Output ``j`` has covariance ``output_scale[j]^2 k(z, z')``. The targets of angular states are stored unwrapped: as
    the representative nearest to the mean's prediction, so that residuals are taken on the circle.

    Args:
        mean_module: gpytorch mean, e.g. ``EpisodicMean(SimulatorMean(simulator))``.
        covar_module: gpytorch kernel over ``D = d + m`` inputs.
        noise: schedule of the relative noise variance; default ``FixedNoise(1e-4)``, or the noise of a ``likelihood``
            that is given.
        likelihood: Gaussian likelihood; default one noise for each output, without gpytorch's lower limit of 1e-4.
        state_space: says which states are angles; default that of the simulator in ``mean_module``.
        output_scale: signal standard deviation of each output in its own unit, ``(d,)``; default ones.
        dtype: the default float64 is needed: at 300 points the median variance is below float32's error.

    Raises:
        ConfigurationError: the number of outputs cannot be known, or the noise is below the likelihood's limit.
        ShapeError: mean, kernel or ``output_scale`` has another number of outputs.

    Example:
        >>> from torch_activegp.means import SimulatorMean
        >>> from torch_activegp.simulators import Pendulum
        >>> gp = DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel())
        >>> gp.update(torch.zeros(1, 2), torch.ones(1, 1), torch.zeros(1, 2))
        >>> gp.posterior.num_points
        1

    Reference: Miller et al. 2024 (arXiv 2403.17233), section III.
    """

    state_space: StateSpace | None
    mean_module: Mean
    covar_module: Kernel
    likelihood: GaussianLikelihood

    def __init__(
        self,
        mean_module: Mean,
        covar_module: Kernel,
        *,
        noise: NoiseSchedule | None = None,
        likelihood: GaussianLikelihood | None = None,
        state_space: StateSpace | None = None,
        output_scale: Tensor | None = None,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        state_space = state_space or _state_space_of(mean_module)
        num_outputs = _num_outputs(mean_module, state_space)
        _check_outputs(num_outputs, mean_module, covar_module, output_scale)
        noise = noise or (FixedNoise(1e-4) if likelihood is None else LearnedNoise())
        likelihood = likelihood or GaussianLikelihood(
            batch_shape=torch.Size([num_outputs]), noise_constraint=gpytorch.constraints.GreaterThan(1e-24)
        )
        super().__init__(None, None, likelihood)
        self.batch_shape = torch.Size([num_outputs])
        self.state_space = state_space
        self.mean_module = mean_module
        self.covar_module = covar_module
        self.noise_schedule = noise
        self.register_buffer("output_scale", torch.ones(num_outputs) if output_scale is None else output_scale.clone())
        self.register_buffer("_counts", torch.tensor([1, 0]), persistent=True)
        self._cache = None
        self._mean_seen, self._seen = Fingerprint(), Fingerprint()
        self.to(dtype)
        self.eval()
        self.apply_schedule()
        self._notice_changes()

    @property
    def num_outputs(self) -> int:
        """The number of outputs ``d``."""
        return self.batch_shape[0]

    @property
    def count(self) -> Count:
        """Points, episode and step so far."""
        episode, step = self._counts.tolist()
        return Count(self.num_points, episode, step)

    def forward(self, x: Tensor) -> MultivariateNormal:
        """The prior at ``x`` ``(d, n, D)``: a batch of ``d`` Gaussians over ``n`` points."""
        mean = self.mean_module(x)
        mean = mean.expand(*torch.broadcast_shapes(mean.shape[:-1], self.batch_shape), mean.shape[-1])
        return MultivariateNormal(mean, self.covar_module(x) * self.output_scale.square()[:, None, None])

    def __call__(self, *args: Any, **kwargs: Any) -> MultivariateNormal:
        """Predict by gpytorch, never from a stale cache; at the start of an episode its mean is the prior m_tau."""
        self._notice_changes()
        output = super().__call__(*args, **kwargs)
        if self.training or not self._holds_prior:
            return output
        return MultivariateNormal(self.mean_module(args[0]), output.lazy_covariance_matrix)

    # -- data ---------------------------------------------------------------------------------------------------------

    @torch.no_grad()
    def update(self, state: Tensor, action: Tensor, next_state: Tensor) -> None:
        """Condition on transitions.

        While the noise schedule holds the noise, each point is appended in O(n^2); otherwise the factor is recomputed
        at the next query.

        Args:
            state: ``(n', d)``.
            action: ``(n', m)``.
            next_state: ``(n', d)``.

        Raises:
            ShapeError: the shapes do not fit each other or the state space.
            DataError: a value is not finite.
            SimulationError: the mean is not finite there.
        """
        z, next_state = check_transitions(self, state, action, next_state)
        if not len(z):
            return
        targets = self._unwrap(z, next_state)
        self._notice_changes()
        before, posterior = self.count, self._cache
        self._counts[1] += z.shape[0]
        self.add_points(z, targets)
        if posterior is not None and posterior.num_points and self.noise_schedule.holds(before, self.count):
            self._append(posterior, z, targets)
        else:
            self._cache = None
            self.apply_schedule()

    def _append(self, posterior: CachedPosterior, z: Tensor, targets: Tensor) -> None:
        try:
            for point, target in zip(z.split(1), targets.split(1), strict=True):
                posterior.append(point, target)
        except torch.linalg.LinAlgError:
            self._cache = None

    def _unwrap(self, z: Tensor, next_state: Tensor) -> Tensor:
        mean = self.mean_module
        reference = mean.base(z) if isinstance(mean, EpisodicMean) else predict_mean(mean, z, self.num_outputs)
        bad = ~torch.isfinite(reference).all(-1)
        if bad.any():
            row = int(bad.nonzero()[0])
            raise SimulationError(
                f"Wanted a finite prediction of the mean at z = {z[row].tolist()}, found {reference[row].tolist()}. "
                "Mend the simulator there, or keep exploration away from it (SafeSet, state bounds)."
            )
        return next_state if self.state_space is None else self.state_space.unwrap(next_state, reference)

    @torch.no_grad()
    def begin_episode(self) -> None:
        """Make the present posterior the mean of the next episode (only with an :class:`EpisodicMean`).

        The factor is computed anew at the next query, so that a run that is resumed here continues bit for bit.
        Called again before there is new data, it changes nothing.
        """
        if isinstance(self.mean_module, EpisodicMean) and self.num_points and not self._holds_prior:
            posterior = self.posterior
            self.mean_module.advance(self.covar_module, self.inputs, posterior.weights)
        if self._counts[1]:
            self._counts[0] += 1
            self._counts[1] = 0
        self.apply_schedule()
        self.forget()

    # -- posterior ----------------------------------------------------------------------------------------------------

    @property
    def posterior(self) -> CachedPosterior:
        """The posterior at the present data and hyper-parameters; recomputed only if one of them changed."""
        self._notice_changes()
        if self._cache is None:
            with torch.no_grad():
                self._cache = CachedPosterior(
                    self.mean_module,
                    self.covar_module,
                    self.inputs,
                    self.targets if self.num_points else self.output_scale.new_zeros(0, self.num_outputs),
                    self._relative_noise(),
                    self.output_scale,
                    self._holds_prior,
                )
        return self._cache

    @property
    def _holds_prior(self) -> bool:
        """Whether the mean is still the episode's prior m_tau (recursion ``"paper"``, no point in this episode)."""
        mean = self.mean_module
        chained = isinstance(mean, EpisodicMean) and mean.recursion == "paper" and len(mean.expansions) > 0
        return chained and self.count.step == 0

    @torch.no_grad()
    def _notice_changes(self) -> None:
        """Forget the posterior if mean, kernel, likelihood or output scale changed, whoever changed them."""
        mean = self.mean_module.base_mean if isinstance(self.mean_module, EpisodicMean) else self.mean_module
        mean_changed = self._mean_seen.changed([mean])
        if self._seen.changed([self.covar_module, self.likelihood], [self.output_scale]) or mean_changed:
            self.forget()
        if mean_changed and self.num_points:  # the mean may have crossed the seam of an angle
            targets = self._unwrap(self.inputs, self.targets)
            self.targets = torch.where((targets - self.targets).abs() > 1e-6, targets, self.targets)

    def _relative_noise(self) -> Tensor:
        """Noise variance over squared output scale: ``(1,)`` where one factor serves all outputs, else ``(d,)``."""
        noise = self.likelihood.noise.detach().reshape(-1) / self.output_scale.square()
        shared_kernel = self.covar_module.batch_shape.numel() == 1
        spread = noise.max() - noise.min()
        return noise.mean().reshape(1) if shared_kernel and bool(spread <= 1e-12 * noise.max()) else noise

    def apply_schedule(self) -> None:
        """Set the likelihood's noise to the schedule's value; after a change of ``output_scale``, for example.

        Raises:
            ConfigurationError: the likelihood's constraint does not allow the value.
        """
        variance = self.noise_schedule.variance(self.count)
        if variance is None:
            return
        noise = (variance * self.output_scale.square()).reshape(self.num_outputs, 1)
        if not self.likelihood.noise.numel() == self.num_outputs:
            noise = noise.mean().reshape(self.likelihood.noise.shape)
        if not self.likelihood.noise_covar.raw_noise_constraint.check(noise):
            raise ConfigurationError(
                f"The noise schedule asks for a variance of {noise.min().item():.3g}, below the likelihood's limit "
                f"{self.likelihood.noise_covar.raw_noise_constraint.lower_bound.item():.3g}. Give the likelihood "
                "noise_constraint=GreaterThan(1e-24), or leave likelihood=None."
            )
        self.likelihood.noise = noise

    def __getstate__(self) -> dict[str, Any]:
        """Pickle without what can be computed again."""
        unseen = {"_mean_seen": Fingerprint(), "_seen": Fingerprint()}
        return {**self.__dict__, **unseen, "_cache": None, "prediction_strategy": None}


def _state_space_of(mean_module: Mean) -> StateSpace | None:
    inner = mean_module.base_mean if isinstance(mean_module, EpisodicMean) else mean_module
    return getattr(inner, "state_space", None)


def _num_outputs(mean_module: Mean, state_space: StateSpace | None) -> int:
    if state_space is not None:
        return state_space.dim
    batch_shape = getattr(mean_module, "batch_shape", None)
    if not batch_shape:
        raise ConfigurationError(
            f"The number of outputs is unknown: {type(mean_module).__name__} has no batch_shape. Pass state_space=..., "
            "or give the mean batch_shape=torch.Size([d])."
        )
    return batch_shape[-1]


def _check_outputs(num_outputs: int, mean: Mean, kernel: Kernel, output_scale: Tensor | None) -> None:
    """Raise a ShapeError where a part has another number of outputs."""
    wanted: dict[str, tuple[torch.Size, list[tuple[int, ...]]]] = {
        "mean_module with batch_shape": (getattr(mean, "batch_shape", torch.Size()), [(), (num_outputs,)]),
        "covar_module with batch_shape": (kernel.batch_shape, [(), (1,), (num_outputs,)]),
    }
    if output_scale is not None:
        wanted["output_scale of shape"] = (output_scale.shape, [(num_outputs,)])
        if not bool(((output_scale > 0) & output_scale.isfinite()).all()):
            raise ConfigurationError(f"Wanted positive, finite output scales, found {output_scale.tolist()}.")
    for part, (found, allowed) in wanted.items():
        if tuple(found) not in allowed:
            raise ShapeError(
                f"Wanted {part} {' or '.join(map(str, allowed))} for {num_outputs} outputs, found {tuple(found)}."
            )
