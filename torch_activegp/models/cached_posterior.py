"""The posterior of a :class:`~torch_activegp.models.DynamicsGP` between two changes, ready for many queries."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from torch_activegp.means import EpisodicMean, KernelExpansion, predict_mean
from torch_activegp.means.kernel_expansion import merge_heads
from torch_activegp.models.inverse_factor import InverseFactor
from torch_activegp.models.kernel_functions import KernelFunction, kernel_function


@dataclass(frozen=True)
class Features:
    """What all posterior quantities at the same points share.

    Attributes:
        z: the points, ``(n', D)``.
        cross: k(z, Z), ``(h, n', n)``.
        simulator_loc: the first episode's mean p0, ``(n', d)``.
        outer: the mean without the terms in ``cross``, ``(n', d)``: p0 and what other hyper-parameters left.
    """

    z: Tensor
    cross: Tensor
    simulator_loc: Tensor
    outer: Tensor


class CachedPosterior:
    """Mean and variance at fixed data and hyper-parameters, equal to gpytorch's own to 1e-8.

    Outputs that share kernel and relative noise share one factor (``h = 1`` head); otherwise each has its own
    (``h = d``). The mean is p0(z) + k(z, Z) A with one cumulative matrix A for all episodes (see
    :class:`~torch_activegp.means.EpisodicMean`); its distance from the episode's prior m_tau is k(z, Z) B, which calls
    no simulator.

    Args:
        mean_module: the GP's mean.
        kernel: the GP's kernel for unit output scale.
        inputs: the points Z, ``(n, D)``.
        targets: next states, ``(n, d)``.
        noise: relative noise variance per head, ``(h,)``.
        output_scale: signal standard deviation per output, ``(d,)``.

    Reference: Rasmussen and Williams 2006, Eq. 2.25 and 2.26; Miller et al. 2024, predictive mean and variance.
    """

    def __init__(
        self,
        mean_module: torch.nn.Module,
        kernel: torch.nn.Module,
        inputs: Tensor,
        targets: Tensor,
        noise: Tensor,
        output_scale: Tensor,
    ) -> None:
        self.mean_module = mean_module
        self.kernel = kernel
        self.noise = noise
        self.output_scale = output_scale
        self.num_outputs = targets.shape[-1]
        self.inputs = inputs
        self._inner, self._outer_terms = self._split_mean()
        size = inputs.shape[0]
        covariance = torch.diag_embed(noise.unsqueeze(-1).expand(-1, size))
        residual = self._split_heads(targets)
        if size:
            self.function: KernelFunction = kernel_function(kernel, inputs)
            covariance = covariance + self.function.cross(inputs)
            residual = self._split_heads(targets - predict_mean(mean_module, inputs, self.num_outputs))
        self.factor = InverseFactor(covariance)
        self._whitened = self.factor.inverse @ residual
        self._set_weights(self.factor.inverse.mT @ self._whitened)

    def _split_mean(self) -> tuple[KernelExpansion | None, list[KernelExpansion]]:
        if not isinstance(self.mean_module, EpisodicMean):
            return None, []
        inner = self.mean_module.inner(self.kernel)
        if inner is not None and not self._is_prefix(inner.centers):
            inner = None
        terms = [term for term in self.mean_module.expansions if term is not inner]
        return inner, terms

    def _is_prefix(self, centers: Tensor) -> bool:
        return centers.shape[0] <= self.inputs.shape[0] and torch.equal(centers, self.inputs[: centers.shape[0]])

    def _split_heads(self, values: Tensor) -> Tensor:
        return values.unsqueeze(0) if self.noise.shape[0] == 1 else values.mT.unsqueeze(-1)

    def _set_weights(self, innovation: Tensor) -> None:
        """Set A (``weights``) and B (``shift``, None where m_tau has another kernel) from S^-1 (y - m(Z))."""
        self._innovation = innovation
        reference = torch.zeros_like(innovation)
        if self._inner is not None:
            reference[:, : self._inner.weights.shape[1]] = self._inner.weights
        if self._conditions_on_base:
            self.weights = innovation
            self.shift = None if self._outer_terms else innovation - reference
        else:
            self.weights = innovation + reference
            self.shift = innovation

    @property
    def _conditions_on_base(self) -> bool:
        return isinstance(self.mean_module, EpisodicMean) and self.mean_module.recursion == "bayes"

    @property
    def num_points(self) -> int:
        """The number of points n."""
        return self.factor.size

    def append(self, z: Tensor, target: Tensor) -> None:
        """Condition on one more point at the same noise, in O(n^2).

        Args:
            z: the point, ``(1, D)``.
            target: its next state, ``(1, d)``.

        Raises:
            torch.linalg.LinAlgError: the point cannot be appended; compute the posterior anew.
        """
        residual = self._split_heads(target - predict_mean(self.mean_module, z, self.num_outputs))
        heads = self.noise.shape[0]
        cross = self.function.cross(z)[:, 0].expand(heads, -1)
        row, pivot = self.factor.append(cross, (self.function.diagonal(z)[:, 0] + self.noise).expand(heads))
        whitened = (residual - row.unsqueeze(-2) @ self._whitened) / pivot[:, None, None]
        self._whitened = torch.cat([self._whitened, whitened], dim=1)
        innovation = torch.nn.functional.pad(self._innovation, (0, 0, 0, 1))
        self.inputs = torch.cat([self.inputs, z])
        self.function = kernel_function(self.kernel, self.inputs)
        self._set_weights(innovation + self.factor.inverse[:, -1:].mT @ whitened)

    @property
    def noise_scale(self) -> Tensor:
        """The standard deviation of the noise, ``(d,)``."""
        return self.noise.sqrt() * self.output_scale

    def simulator_loc(self, z: Tensor) -> Tensor:
        """The first episode's mean p0 at ``z`` ``(n', D)``: ``(n', d)``."""
        if isinstance(self.mean_module, EpisodicMean):
            return self.mean_module.base(z)
        return predict_mean(self.mean_module, z, self.num_outputs)

    def features(self, z: Tensor, simulator_loc: Tensor | None = None, out: Tensor | None = None) -> Features:
        """Evaluate kernel and simulator once for several quantities.

        Args:
            z: points, ``(n', D)``.
            simulator_loc: p0(z), ``(n', d)``, where it is known already.
            out: memory for k(z, Z), ``(h, n', n)``.

        Returns:
            What :meth:`loc`, :meth:`prior_loc` and :meth:`scale` need.
        """
        base = self.simulator_loc(z) if simulator_loc is None else simulator_loc
        outer = base
        if self._outer_terms and not self._conditions_on_base:
            outer = base + sum(term(z) for term in self._outer_terms)
        if not self.num_points:
            self.function = kernel_function(self.kernel, z[:1])
            return Features(z, z.new_zeros(self.noise.shape[0], z.shape[0], 0), base, outer)
        return Features(z, self.function.cross(z, out), base, outer)

    def loc(self, features: Features) -> Tensor:
        """The posterior mean mu of the next state, ``(n', d)``; angles are not wrapped."""
        return features.outer + merge_heads(features.cross @ self.weights)

    def prior_loc(self, features: Features) -> Tensor:
        """The episode's prior m_tau, ``(n', d)``; where hyper-parameters did not change it costs one small product."""
        if self.shift is None:
            return features.outer + sum(term(features.z) for term in self.mean_module.expansions)
        return features.outer + merge_heads(features.cross @ (self.weights - self.shift))

    def variance(self, features: Features) -> Tensor:
        """The posterior variance sigma^2 of the noise-free next state, ``(n', d)``."""
        unit = self.function.diagonal(features.z) - self.factor.squared_norm(features.cross)
        return unit.clamp_min(0.0).mT * self.output_scale.square()

    def scale(self, features: Features) -> Tensor:
        """The posterior standard deviation sigma, ``(n', d)``."""
        return self.variance(features).sqrt()
