"""A force on each recorded joint as a Gaussian process, learned from free forces in bins of time."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import gpytorch
import numpy as np
import torch
from gpytorch.kernels import MaternKernel, ScaleKernel
from gpytorch.likelihoods import GaussianLikelihood
from gpytorch.priors import LogNormalPrior
from numpy.typing import NDArray
from scipy.optimize import minimize
from torch import Tensor

from torch_activegp.diagnosis.inputs.runs import Array, Channels
from torch_activegp.physics.effect import Effect, Index, Step

_TRAINED_BINS = 1500
_POINTS = 240
_ITERATIONS = 30
_JITTER = 1e-6
_NOISE, _FIRST_NOISE = (-3.0, 3.0), 0.1
"""Prior of the variance of what is left that is no function of (q, v, u), in squares of the unit of force, as mean and
standard deviation of its logarithm; and where the search for it begins. Without such noise a force that is periodic in
time was learned with short length-scales, and forecast kept data 1600 times worse than none. It is 1e-4 at least."""
_ROOT5 = math.sqrt(5.0)


@dataclasses.dataclass(frozen=True, eq=False)
class Remainder(Effect):
    """A force on each recorded joint as a function of the recorded joints' (q, v) and the controls u.

    Args:
        positions: addresses of the recorded joints' positions, ``(C,)``.
        velocities: addresses of their velocities, ``(C,)``.
        centre: subtracted from the inputs, ``(D,)``, D = 2 C + nu.
        points: inducing inputs over the length-scales, ``(C, m, D)``.
        length_scales: of each joint's kernel, in the inputs' units, ``(C, D)``.
        weights: the posterior mean is Matern-5/2(z, points) weights, ``(C, m)``, N m or N.
    """

    positions: NDArray[np.int64] = dataclasses.field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    velocities: NDArray[np.int64] = dataclasses.field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    centre: Array = dataclasses.field(default_factory=lambda: np.zeros(0))
    points: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0, 0)))
    length_scales: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    weights: Array = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))

    name = "remainder"
    law = "GP(q, v, u)"
    needs_steps = True

    def force(self, inputs: Array) -> Array:
        """The posterior mean at (q, v, u) ``(n, D)``: ``(n, C)``, N m or N."""
        out = np.empty((len(inputs), len(self.weights)))
        for c, (points, scales, weights) in enumerate(zip(self.points, self.length_scales, self.weights, strict=True)):
            out[:, c] = _matern((inputs - self.centre) / scales, points) @ weights
        return out

    def before_step(self, step: Step, rows: Index, values: Array, memory: Array | None) -> None:
        """Adds the force at the start of each time step."""
        force = self.force(
            np.concatenate(
                [step.qpos[rows][:, self.positions], step.qvel[rows][:, self.velocities], step.ctrl[rows]], axis=1
            )
        )
        step.force[np.asarray(rows)[:, None], self.velocities] += force


def _matern(a: Array, b: Array) -> Array:
    """Matern-5/2 of inputs over their length-scales: ``(n, D)``, ``(m, D)`` to ``(n, m)``."""
    square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2.0 * a @ b.T
    distance = np.sqrt(np.maximum(square, 0.0)) * _ROOT5
    return np.asarray((1.0 + distance + distance**2 / 3.0) * np.exp(-distance))


@dataclasses.dataclass(frozen=True)
class Bins:
    """Normal equations of a force on each joint held over bins of time, after the free states are projected out.

    Args:
        inputs: mean (q, v, u) of each bin, ``(S, B, D)``.
        normal: ``(S, C, B, C, B)``.
        gradient: ``(S, C, B)``.
    """

    inputs: Array
    normal: Array
    gradient: Array

    def pick(self, which: NDArray[Any]) -> Bins:
        """Some of the segments."""
        return Bins(self.inputs[which], self.normal[which], self.gradient[which])

    def beside_own_forces(self, noise: Tensor, unit: Array) -> tuple[Tensor, Tensor, Tensor]:
        """The equations of what is a function, beside a force of its own in each bin that is none.

        Args:
            noise: variance of the latter, ``(C,)``, in squares of the unit.
            unit: of force, ``(C,)``, N m or N.

        Returns:
            Normal matrices ``(S, C, B, C, B)``, gradients ``(S, C, B)``, and the logarithm of the evidence that does
            not depend on the function.
        """
        size, joints, number = self.gradient.shape
        scale = torch.from_numpy(unit).repeat_interleave(number)
        normal = torch.from_numpy(self.normal).reshape(size, joints * number, -1) * scale[:, None] * scale
        gradient = torch.from_numpy(self.gradient).reshape(size, -1, 1) * scale[:, None]
        variance = noise.repeat_interleave(number)
        mixed = torch.eye(joints * number, dtype=torch.float64) + normal * variance
        less = torch.linalg.solve(mixed, torch.cat([normal, gradient], dim=-1))
        evidence = 0.5 * (gradient * variance[:, None] * less[..., -1:]).sum()
        evidence = evidence - 0.5 * torch.linalg.slogdet(mixed).logabsdet.sum()
        shape, matrix = (size, joints, number), less[..., :-1]
        matrix = 0.5 * (matrix + matrix.mT)
        return matrix.reshape(*shape, joints, number), less[..., -1].reshape(shape), evidence


class ForceGP:
    """Hyper-parameters, inducing points, and the units of inputs and forces."""

    def __init__(self, bins: Bins, channels: Channels) -> None:
        self.channels = channels
        flat = bins.inputs.reshape(-1, bins.inputs.shape[-1])
        self.centre, spread = flat.mean(0), flat.std(0)
        self.spread = np.where(spread > 1e-9, spread, 1.0)
        self.points = _spread_out(self._standard(flat), max(_POINTS // len(channels.joints), 40))
        diagonal = np.einsum("scbcb->c", bins.normal)
        power = np.einsum("scbcd,scbcd->c", bins.normal, bins.normal)
        moment = (np.einsum("scb,scb->c", bins.gradient, bins.gradient) - diagonal) / np.maximum(power, 1e-300)
        self.unit = np.sqrt(np.maximum(moment, 1e-6 * diagonal / np.maximum(power, 1e-300)))
        size = torch.Size([len(channels.joints)])
        base = MaternKernel(
            2.5, ard_num_dims=len(self.centre), batch_shape=size, lengthscale_prior=LogNormalPrior(0.0, 1.0)
        )
        self.kernel = ScaleKernel(base, batch_shape=size, outputscale_prior=LogNormalPrior(0.0, 1.0)).double()
        base.lengthscale, self.kernel.outputscale = 1.0, 1.0
        self.likelihood = GaussianLikelihood(LogNormalPrior(*_NOISE), batch_shape=size).double()
        self.likelihood.noise = _FIRST_NOISE

    @classmethod
    def on(cls, bins: Bins, channels: Channels) -> ForceGP:
        """Fits the hyper-parameters."""
        trained = cls(bins, channels)
        share = min(_TRAINED_BINS / bins.gradient.size, 1.0)
        count = max(int(share * len(bins.inputs)), 1)
        some = bins.pick(np.unique(np.linspace(0, len(bins.inputs) - 1, count).round().astype(np.int64)))
        trained._fit(some)
        return trained

    def _standard(self, inputs: Array) -> Array:
        return (inputs - self.centre) / self.spread

    def _equations(self, bins: Bins) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """K(U, U), the information on the weights and the gradient, all over ``C m``; and the rest of the evidence."""
        points = torch.from_numpy(self.points)
        inputs = torch.from_numpy(self._standard(bins.inputs))
        size, number = inputs.shape[:2]
        with gpytorch.settings.lazily_evaluate_kernels(False):
            prior = self.kernel(points).to_dense()
            columns = self.kernel(inputs.reshape(size * number, -1), points).to_dense()
        columns = columns.unflatten(1, (size, number))
        normal, gradient, evidence = bins.beside_own_forces(self.likelihood.noise[:, 0], self.unit)
        half = torch.einsum("scbed,esdn->cbsen", normal, columns)
        count = prior.shape[-1]
        information = torch.einsum("csbm,cbsen->cmen", columns, half).reshape(len(self.unit) * count, -1)
        forced = torch.einsum("csbm,scb->cm", columns, gradient).reshape(-1)
        jitter = _JITTER * self.kernel.outputscale[:, None, None] * torch.eye(count, dtype=torch.float64)
        return torch.block_diag(*(prior + jitter)), information, forced, evidence

    def _loss(self, bins: Bins) -> Tensor:
        """Negative log posterior of the hyper-parameters."""
        prior, information, forced, evidence = self._equations(bins)
        factor = torch.linalg.cholesky(prior + information)
        solved = torch.linalg.solve_triangular(factor, forced[:, None], upper=False)
        volume = factor.diagonal().log().sum() - torch.linalg.cholesky(prior).diagonal().log().sum()
        owners = (self.kernel, self.likelihood)
        priors = [p.log_prob(value(own)).sum() for each in owners for _, own, p, value, _ in each.named_priors()]
        return volume - 0.5 * solved.square().sum() - evidence - torch.stack(priors).sum()

    def _fit(self, bins: Bins) -> None:
        parameters = [*self.kernel.parameters(), *self.likelihood.parameters()]
        shapes = [p.numel() for p in parameters]

        def load(vector: Array) -> None:
            for p, values in zip(parameters, torch.from_numpy(vector.copy()).split(shapes), strict=True):
                p.data.copy_(values.reshape(p.shape))
                p.grad = None

        def objective(vector: Array) -> tuple[float, Array]:
            load(vector)
            try:
                loss = self._loss(bins)
            except torch.linalg.LinAlgError:
                return 1e12, np.zeros_like(vector)
            loss.backward()
            return loss.item(), torch.cat([p.grad.reshape(-1) for p in parameters if p.grad is not None]).numpy()

        start = torch.cat([p.detach().reshape(-1) for p in parameters]).numpy()
        load(minimize(objective, start, jac=True, method="L-BFGS-B", options={"maxiter": _ITERATIONS}).x)

    @torch.no_grad()
    def posterior(self, bins: Bins) -> Remainder:
        """The posterior mean."""
        prior, information, forced, _ = self._equations(bins)
        weights = torch.linalg.solve(prior + information, forced).reshape(len(self.unit), -1)
        weights = weights * self.kernel.outputscale[:, None] * torch.from_numpy(self.unit)[:, None]
        scales = self.kernel.base_kernel.lengthscale[:, 0].numpy()
        return Remainder(
            "world",
            (),
            np.zeros((0, 0)),
            positions=self.channels.qpos,
            velocities=self.channels.dof,
            centre=self.centre,
            points=self.points / scales[:, None, :],
            length_scales=scales * self.spread,
            weights=weights.numpy(),
        )


def _spread_out(inputs: Array, count: int) -> Array:
    """The farthest-point choice of some inputs, begun with the one nearest to their mean."""
    count = min(count, len(inputs))
    chosen = [int((inputs**2).sum(1).argmin())]
    distance = ((inputs - inputs[chosen[0]]) ** 2).sum(1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, ((inputs - inputs[chosen[-1]]) ** 2).sum(1))
    return np.asarray(inputs[chosen])
