"""The posterior of a :class:`~torch_activegp.models.DynamicsGP` between two changes, ready for many queries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from gpytorch import settings
from gpytorch.kernels import Kernel
from gpytorch.means import Mean
from torch import Tensor

from torch_activegp.means import EpisodicMean, KernelExpansion, predict_mean
from torch_activegp.means.kernel_expansion import merge_heads
from torch_activegp.models.inverse_factor import InverseFactor
from torch_activegp.models.kernel_functions import KernelFunction, kernel_function


class Features(NamedTuple):
    """What all posterior quantities at the same points share.

    Attributes:
        z: the points, ``(n', D)``.
        cross: k(z, Z), ``(h, n', n)``, or ``(1, n', n)`` where all heads share the kernel.
        simulator_loc: the first episode's mean p0, ``(n', d)``.
        outer: the mean without the terms in ``cross``, ``(n', d)``: p0 and what other hyper-parameters left.
    """

    z: Tensor
    cross: Tensor
    simulator_loc: Tensor
    outer: Tensor

    @classmethod
    def join(cls, parts: Sequence[Features], z: Tensor, cross: Tensor) -> Features:
        """Put the features of several sets of points in a row; ``z`` and ``cross`` are those of all points."""
        simulator_loc = torch.cat([part.simulator_loc for part in parts])
        if parts[0].outer is parts[0].simulator_loc:
            return cls(z, cross, simulator_loc, simulator_loc)
        return cls(z, cross, simulator_loc, torch.cat([part.outer for part in parts]))


class CachedPosterior:
    """Mean and variance at fixed data and hyper-parameters, equal to gpytorch's own to 1e-8.

    Outputs that share kernel and relative noise share one factor (``h = 1`` head); otherwise each has its own
    (``h = d``). The mean is p0(z) + k(z, Z) A with one cumulative matrix A for all episodes (see
    :class:`~torch_activegp.means.EpisodicMean`). The episode's prior is m_tau(z) = p0(z) + k(z, Z) B, so the distance
    between the two calls no simulator.

    Args:
        mean_module: the GP's mean.
        kernel: the GP's kernel for unit output scale.
        inputs: the points Z, ``(n, D)``.
        targets: next states, ``(n, d)``.
        noise: relative noise variance per head, ``(h,)``.
        output_scale: signal standard deviation per output, ``(d,)``.
        holds_prior: the mean is still the episode's prior m_tau, until the next point: mu_{tau, 0} = m_tau.

    Reference: Rasmussen and Williams 2006, Eq. 2.25 and 2.26; Miller et al. 2024, predictive mean and variance.
    """

    def __init__(
        self,
        mean_module: Mean,
        kernel: Kernel,
        inputs: Tensor,
        targets: Tensor,
        noise: Tensor,
        output_scale: Tensor,
        holds_prior: bool = False,
    ) -> None:
        self.holds_prior = holds_prior
        self.mean_module = mean_module
        self.base_mean = mean_module.base_mean if isinstance(mean_module, EpisodicMean) else mean_module
        self.kernel = kernel
        self.noise = noise
        self.output_scale = output_scale
        self.num_outputs = targets.shape[-1]
        self.inputs = inputs
        self._inner, self._outer_terms = self._split_mean()
        covariance = noise.new_zeros(noise.shape[0], 0, 0)
        residual = self._split_heads(targets)
        self._function: KernelFunction | None = None
        if inputs.shape[0]:
            self._function = kernel_function(kernel, inputs)
            covariance = self._function.cross(inputs).expand(noise.shape[0], -1, -1).contiguous()
            covariance.diagonal(dim1=-2, dim2=-1).add_(noise.unsqueeze(-1))
            residual = self._split_heads(targets - predict_mean(mean_module, inputs, self.num_outputs))
        self.factor = InverseFactor(covariance)
        self._whitened = self.factor.inverse @ residual
        self._set_weights(self.factor.inverse.mT @ self._whitened)

    def _split_mean(self) -> tuple[KernelExpansion | None, list[KernelExpansion]]:
        if not isinstance(self.mean_module, EpisodicMean):
            return None, []
        mean = self.mean_module
        return mean.inner(self.kernel, self.inputs), mean.outer(self.kernel, self.inputs)

    def _split_heads(self, values: Tensor) -> Tensor:
        return values.unsqueeze(0) if self.noise.shape[0] == 1 else values.mT.unsqueeze(-1)

    def _set_weights(self, innovation: Tensor) -> None:
        """Set A (``weights``) and B (``_prior_weights``) from S^-1 (y - m(Z))."""
        self._innovation = innovation
        self._prior_weights = None
        weights = torch.zeros_like(innovation) if self.holds_prior else innovation
        if self._inner is not None:
            self._prior_weights = _by_columns(self._split_heads(merge_heads(self._inner.weights)))
            if not self._conditions_on_base:
                weights = weights.clone()
                weights[:, : self._prior_weights.shape[1]] += self._prior_weights
        self.weights = _by_columns(weights)

    @property
    def _conditions_on_base(self) -> bool:
        return isinstance(self.mean_module, EpisodicMean) and self.mean_module.recursion == "bayes"

    @property
    def num_points(self) -> int:
        """The number of points n."""
        return self.factor.size

    @property
    def num_kernels(self) -> int:
        """The number of kernels: 1 where all outputs share it, else d."""
        return self.kernel.batch_shape.numel()

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
        function = self._function_at(z)
        cross = function.cross(z)[:, 0].expand(heads, -1)
        row, pivot = self.factor.append(cross, (function.diagonal(z)[:, 0] + self.noise).expand(heads))
        whitened = (residual - row.unsqueeze(-2) @ self._whitened) / pivot[:, None, None]
        self._whitened = torch.cat([self._whitened, whitened], dim=1)
        innovation = torch.nn.functional.pad(self._innovation, (0, 0, 0, 1))
        self.holds_prior = False
        self.inputs = torch.cat([self.inputs, z])
        self._function = kernel_function(self.kernel, self.inputs)
        self._set_weights(innovation + self.factor.inverse[:, -1:].mT @ whitened)

    @property
    def noise_scale(self) -> Tensor:
        """The standard deviation of the noise, ``(d,)``."""
        return self.noise.sqrt() * self.output_scale

    def simulator_loc(self, z: Tensor) -> Tensor:
        """The first episode's mean p0 at ``z`` ``(n', D)``: ``(n', d)``."""
        return predict_mean(self.base_mean, z, self.num_outputs)

    def features(self, z: Tensor, simulator_loc: Tensor | None = None, out: Tensor | None = None) -> Features:
        """Evaluate kernel and simulator once for several quantities.

        Args:
            z: points, ``(n', D)``.
            simulator_loc: p0(z), ``(n', d)``, where it is known already.
            out: memory for k(z, Z), ``(num_kernels, n', n)``.

        Returns:
            What :meth:`loc`, :meth:`prior_loc` and :meth:`scale` need.
        """
        base = self.simulator_loc(z) if simulator_loc is None else simulator_loc
        outer = base
        if self._outer_terms and not self._conditions_on_base:
            outer = base + sum(term(z) for term in self._outer_terms)
        if not self.num_points:
            return Features(z, z.new_zeros(self.num_kernels, z.shape[0], 0), base, outer)
        return Features(z, self._function_at(z).cross(z, out), base, outer)

    def loc(self, features: Features) -> Tensor:
        """The posterior mean mu of the next state, ``(n', d)``; angles are not wrapped."""
        return _add_product(features.outer, features.cross, self.weights)

    def prior_loc(self, features: Features) -> Tensor:
        """The episode's prior m_tau, ``(n', d)``; where hyper-parameters did not change it costs one small product."""
        loc = features.outer
        if self._outer_terms and self._conditions_on_base:
            loc = loc + sum(term(features.z) for term in self._outer_terms)
        if self._prior_weights is None:
            return loc
        return _add_product(loc, features.cross[..., : self._prior_weights.shape[1]], self._prior_weights)

    def variance(self, features: Features) -> Tensor:
        """The posterior variance sigma^2 of the noise-free next state, ``(n', d)``."""
        return self._unit_variance(features).mT * self.output_scale.square()

    def scale(self, features: Features) -> Tensor:
        """The posterior standard deviation sigma, ``(n', d)``."""
        return self._unit_variance(features).sqrt().mT * self.output_scale

    def prior_covariance(self, first: Tensor, second: Tensor) -> Tensor:
        """The kernel for unit output scale: ``(..., n', D)`` and ``(..., n'', D)`` to ``(..., n', n'')``."""
        with settings.lazily_evaluate_kernels(False):
            return self.kernel(first, second).to_dense()

    def _unit_variance(self, features: Features) -> Tensor:
        diagonal = self._function_at(features.z).diagonal(features.z)
        variance = diagonal - self.factor.squared_norm(features.cross)
        return variance.clamp_min(torch.finfo(variance.dtype).tiny)  # not 0, where the square root has no gradient

    def _function_at(self, z: Tensor) -> KernelFunction:
        if self._function is None:  # without data the number of inputs is known at the first query
            self._function = kernel_function(self.kernel, z[:0])
        return self._function


def _add_product(start: Tensor, cross: Tensor, weights: Tensor) -> Tensor:
    """Add k(z, Z) A to a start: ``(n', d)``, ``(h, n', n)``, ``(h, n, d / h)`` to ``(n', d)``."""
    if weights.shape[0] == 1:
        return torch.addmm(start, cross[0], weights[0])
    return start + merge_heads(cross @ weights)


def _by_columns(weights: Tensor) -> Tensor:
    """The same ``(h, n, d / h)`` with its columns side by side in memory: thin products are then 3 times faster."""
    return weights.mT.contiguous().mT
