"""Hyper-parameters by maximum a posteriori marginal likelihood, with outputs in standard units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import gpytorch
import numpy as np
import torch
from gpytorch.kernels import RBFKernel, ScaleKernel
from gpytorch.priors import LogNormalPrior
from linear_operator.utils.cholesky import psd_safe_cholesky
from linear_operator.utils.errors import NanError, NotPSDError
from scipy.optimize import minimize
from torch import Tensor

from torch_activegp.errors import ConfigurationError
from torch_activegp.means import EpisodicMean, predict_mean
from torch_activegp.models.dynamics_gp import DynamicsGP

_SMALLEST_NOISE, _FIRST_NOISE, _LARGEST_NOISE = 1e-8, 1e-2, 10.0
_FLOOR = 1e-9
_VERY_BAD = 1e6


@dataclass(frozen=True)
class FitResult:
    """What a fit arrived at.

    Attributes:
        loss: negative log posterior of the hyper-parameters, per point and output.
        noise: relative noise variance; None where the schedule sets it.
        output_scale: standard deviation of the residual of each output, ``(d,)``.
        converged: whether the optimiser met its tolerance within its iterations.
    """

    loss: float
    noise: float | None
    output_scale: Tensor
    converged: bool


def scaled_rbf(low: Tensor, high: Tensor) -> ScaleKernel:
    """An RBF kernel with one length-scale a dimension and priors in the units of the box.

    The length-scale's log-normal prior has its median at a quarter of the range and a factor of 2.7 as one standard
    deviation; the signal variance has median 1 (outputs are standardised).

    Args:
        low: lower ends of the inputs, ``(D,)``.
        high: upper ends, ``(D,)``.

    Raises:
        ConfigurationError: an end is infinite, or a range is empty.
    """
    extent = high - low
    if not bool((torch.isfinite(extent) & (extent > 0)).all()):
        raise ConfigurationError(
            f"Wanted finite, non-empty ranges, found {extent.tolist()}. Pass the smallest and largest input of your "
            "data where the state space has no bounds."
        )
    median = extent.detach() / 4
    base = RBFKernel(ard_num_dims=len(median), lengthscale_prior=LogNormalPrior(median.log(), torch.ones_like(median)))
    kernel = ScaleKernel(base, outputscale_prior=LogNormalPrior(0.0, 1.0)).to(median)
    base.lengthscale, kernel.outputscale = median, 1.0
    return kernel


def fit_hyperparameters(
    gp: DynamicsGP,
    *,
    max_points: int = 500,
    max_iterations: int = 50,
    standardize: bool = True,
    generator: torch.Generator | None = None,
) -> FitResult:
    """Fit kernel, noise and trainable mean parameters of a GP to its own data.

    Each output's residual about the base mean (the simulator) is divided by its root mean square, so that one kernel
    fits all outputs. All priors registered on the modules enter. The noise is fitted when the GP's schedule is
    :class:`~torch_activegp.models.LearnedNoise`, else it keeps the schedule's value. At the new output scale, and on
    the fitted subset, the result is never worse than the hyper-parameters were before. Call it between episodes: after
    :meth:`DynamicsGP.begin_episode`, which keeps a snapshot of the kernel that the past posterior was made with.

    Args:
        gp: its ``covar_module``, ``output_scale`` and ``likelihood`` are set in place.
        max_points: a random subset of this size is fitted when there are more points.
        max_iterations: of L-BFGS.
        standardize: set ``output_scale`` to the root mean square residual; else it is left alone.
        generator: picks the subset; one with seed 0 when None.

    Returns:
        What the fit arrived at.

    Raises:
        ConfigurationError: fewer than two points.

    Reference: Rasmussen and Williams 2006, Eq. 5.8.
    """
    if gp.num_points < 2:
        raise ConfigurationError(f"Wanted at least 2 points to fit, found {gp.num_points}. Collect an episode first.")
    with gpytorch.settings.lazily_evaluate_kernels(False):
        objective = _Objective(gp, _subset(gp, max_points, generator), standardize)
        start = objective.pack()
        if not start.size:
            return objective.finish(start, converged=True)
        result = minimize(objective, start, jac=True, method="L-BFGS-B", options={"maxiter": max_iterations})
        best = result.x if result.fun <= objective(start)[0] else start
        return objective.finish(best, bool(result.success))


def _subset(gp: DynamicsGP, max_points: int, generator: torch.Generator | None) -> Tensor:
    if gp.num_points <= max_points:
        return torch.arange(gp.num_points, device=gp.inputs.device)
    generator = torch.Generator().manual_seed(0) if generator is None else generator
    return torch.randperm(gp.num_points, generator=generator)[:max_points].to(gp.inputs.device)


class _Objective:
    """Negative log posterior of the hyper-parameters as a function that scipy can minimise."""

    def __init__(self, gp: DynamicsGP, rows: Tensor, standardize: bool) -> None:
        self.gp = gp
        self.mean = gp.mean_module.base_mean if isinstance(gp.mean_module, EpisodicMean) else gp.mean_module
        self.z, self.targets = gp.inputs[rows], gp.targets[rows]
        with torch.no_grad():
            self.residual = self._residual()
        present_noise = (gp.likelihood.noise.detach().reshape(-1) / gp.output_scale.square()).mean()
        if standardize:
            floor = _FLOOR * self.targets.abs().amax(0).clamp_min(1.0)
            gp.output_scale = self.residual.square().mean(0).sqrt().maximum(floor)
        trained: Sequence[Tensor] = [
            p for module in (self.mean, gp.covar_module) for p in module.parameters() if p.requires_grad
        ]
        self.mean_is_trained = any(p.requires_grad for p in self.mean.parameters())
        self.fixed_noise = gp.noise_schedule.variance(gp.count)
        self.log_noise: Tensor | None = None
        self.parameters = list(trained)
        if self.fixed_noise is None:
            limit = gp.likelihood.noise_covar.raw_noise_constraint.lower_bound.item() * (1 + 1e-6)
            allowed = limit / gp.output_scale.square().min().item()
            self.smallest_noise = min(max(_SMALLEST_NOISE, allowed), _LARGEST_NOISE)
            self.log_noise = self._better_start(present_noise)
            self.parameters.append(self.log_noise)

    def _residual(self) -> Tensor:
        """Targets minus the mean, ``(n, d)``; on the circle, for the mean may cross the seam while it is trained."""
        mean = predict_mean(self.mean, self.z, self.gp.num_outputs)
        space = self.gp.state_space
        return self.targets - mean if space is None else space.difference(self.targets, mean)

    def _better_start(self, present_noise: Tensor) -> Tensor:
        """The logarithm of the better of two relative noises to start from: the present one, and a small one."""
        losses = []
        for noise in (present_noise, torch.full_like(present_noise, _FIRST_NOISE)):
            self.log_noise = noise.clamp(self.smallest_noise, _LARGEST_NOISE).log().requires_grad_()
            losses.append((self(self.pack())[0], self.log_noise))
        return min(losses, key=lambda pair: pair[0])[1]

    def pack(self) -> np.ndarray:
        """The parameters as one vector."""
        return torch.cat([self.residual.new_zeros(0), *(p.detach().reshape(-1) for p in self.parameters)]).cpu().numpy()

    def unpack(self, vector: np.ndarray) -> None:
        """Write a vector into the parameters."""
        flat = torch.as_tensor(vector).to(self.residual)
        for p, part in zip(self.parameters, flat.split([p.numel() for p in self.parameters]), strict=True):
            p.data.copy_(part.reshape(p.shape))

    def noise(self) -> Tensor:
        """The relative noise variance."""
        if self.log_noise is None:
            return self.residual.new_tensor(self.fixed_noise)
        return self.log_noise.exp().clamp(self.smallest_noise, _LARGEST_NOISE)

    def loss(self) -> Tensor:
        """Negative log posterior per point and output."""
        residual = self._residual() if self.mean_is_trained else self.residual
        standard = residual / self.gp.output_scale
        covariance = self.gp.covar_module(self.z).to_dense()
        eye = torch.eye(covariance.shape[-1], dtype=covariance.dtype, device=covariance.device)
        factor = psd_safe_cholesky(covariance + self.noise() * eye)
        heads = standard if factor.dim() == 2 else standard.mT.unsqueeze(-1)
        whitened = torch.linalg.solve_triangular(factor, heads, upper=False)
        half_log_determinant = factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        per_head = standard.shape[-1] if factor.dim() == 2 else 1
        log_likelihood = -0.5 * whitened.square().sum() - per_head * half_log_determinant.sum()
        log_prior = sum(self._log_priors(), start=log_likelihood.new_zeros(()))
        return -(log_likelihood + log_prior) / standard.numel() + 0.5 * np.log(2 * np.pi)

    def _log_priors(self) -> list[Tensor]:
        modules = (self.gp.covar_module, self.mean)
        priors = [
            prior.log_prob(closure(owner)).sum()
            for module in modules
            for _, owner, prior, closure, _ in module.named_priors()
        ]
        if self.log_noise is None:
            return priors
        noise = self._noise_of_likelihood()
        return priors + [prior.log_prob(noise).sum() for _, _, prior, _, _ in self.gp.likelihood.named_priors()]

    def _noise_of_likelihood(self) -> Tensor:
        """The noise variance in the likelihood's shape and unit."""
        variance = self.noise() * self.gp.output_scale.square()
        shape = self.gp.likelihood.noise.shape
        return variance.reshape(shape) if shape.numel() == self.gp.num_outputs else variance.mean().reshape(shape)

    def __call__(self, vector: np.ndarray) -> tuple[float, np.ndarray]:
        """Value and gradient at a vector; a point where the loss cannot be computed is very bad."""
        self.unpack(vector)
        for p in self.parameters:
            p.grad = None
        try:
            value = self.loss()
        except (NotPSDError, NanError):
            return _VERY_BAD, np.zeros_like(vector)
        if not bool(torch.isfinite(value)):
            return _VERY_BAD, np.zeros_like(vector)
        value.backward()
        return value.item(), torch.cat([self._gradient(p) for p in self.parameters]).cpu().numpy()

    @staticmethod
    def _gradient(parameter: Tensor) -> Tensor:
        gradient = torch.zeros_like(parameter) if parameter.grad is None else parameter.grad
        return gradient.reshape(-1)

    def finish(self, vector: np.ndarray, converged: bool) -> FitResult:
        """Keep the best vector and hand the noise to the likelihood."""
        self.unpack(vector)
        for p in self.parameters:
            p.grad = None
        with torch.no_grad():
            loss, noise = self.loss().item(), None
            if self.log_noise is None:
                self.gp.apply_schedule()
            else:
                noise = self.noise().item()
                self.gp.likelihood.noise = self._noise_of_likelihood()
        return FitResult(loss, noise, self.gp.output_scale.clone(), converged)
