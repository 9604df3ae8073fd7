"""gpytorch kernels as plain functions of the query points, with everything else computed once.

A planner asks for k(z, Z) at a few dozen points, hundreds of times between two data points, and gpytorch's own call
costs more than the arithmetic. :func:`kernel_function` recognises the common kernels and evaluates them in a handful
of tensor operations; for any other kernel it calls gpytorch. Both give the same numbers (tested to 1e-10).
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import torch
from gpytorch import settings
from gpytorch.kernels import Kernel, MaternKernel, RBFKernel, ScaleKernel
from torch import Tensor

_FAR = 1e3
"""Squared distance from zero, in length-scales, up to which rounding in the exponent stays below 1e-12."""


class KernelFunction(ABC):
    """The functions z -> k(z, Z) and z -> k(z, z) for fixed Z and hyper-parameters; ``h`` heads."""

    @abstractmethod
    def cross(self, z: Tensor, out: Tensor | None = None) -> Tensor:
        """k(z, Z): ``(n', D)`` to ``(h, n', n)``, written to ``out`` if given (then without gradients)."""

    @abstractmethod
    def diagonal(self, z: Tensor) -> Tensor:
        """k(z, z): ``(n', D)`` to ``(h, n')`` or broadcastable to it."""


class GpytorchFunction(KernelFunction):
    """Any kernel, evaluated by gpytorch itself."""

    def __init__(self, kernel: Kernel, centers: Tensor) -> None:
        self.kernel = kernel
        self.centers = centers

    def cross(self, z: Tensor, out: Tensor | None = None) -> Tensor:
        """See :class:`KernelFunction`."""
        with settings.lazily_evaluate_kernels(False):
            values = self.kernel(z, self.centers).to_dense()
        values = values.reshape(-1, *values.shape[-2:])
        return values if out is None else out.copy_(values)

    def diagonal(self, z: Tensor) -> Tensor:
        """See :class:`KernelFunction`."""
        values = self.kernel(z, z, diag=True)
        return values.reshape(-1, values.shape[-1])


class RBFFunction(KernelFunction):
    """outputscale * exp(-|(z - Z) / l|^2 / 2).

    The exponent comes from one large and one small matrix product: z . (Z / l^2) - |z / l|^2 / 2 - |Z / l|^2 / 2. Where
    Z lies far from zero, its mean is subtracted first, so that nothing cancels.

    Args:
        inverse_lengthscale: 1 / l, ``(1,)`` or ``(D,)``.
        centers: the points Z, ``(n, D)``.
        outputscale: signal variance, scalar tensor.

    Reference: Rasmussen and Williams 2006, Eq. 4.9.
    """

    def __init__(self, inverse_lengthscale: Tensor, centers: Tensor, outputscale: Tensor) -> None:
        self.outputscale = outputscale
        precision = inverse_lengthscale.square().expand(centers.shape[-1])
        self.center: Tensor | None = None
        if bool((centers.square() @ precision > _FAR).any()):
            self.center = centers.mean(0)
            centers = centers - self.center
        scaled = centers * precision
        self.scaled_centers = scaled.mT.contiguous()
        self.bias = outputscale.log() - (scaled * centers).sum(-1) / 2
        self.minus_half_precision = precision.unsqueeze(-1) / -2

    def cross(self, z: Tensor, out: Tensor | None = None) -> Tensor:
        """See :class:`KernelFunction`."""
        z = z if self.center is None else z - self.center
        target = None if out is None else out[0]
        exponent = torch.addmm(self.bias, z, self.scaled_centers, out=target)
        return exponent.add_(torch.mm(z * z, self.minus_half_precision)).exp_().unsqueeze(0)

    def diagonal(self, z: Tensor) -> Tensor:
        """See :class:`KernelFunction`."""
        return self.outputscale.reshape(1, 1)


class MaternFunction(KernelFunction):
    """The Matern kernel with nu = 1/2, 3/2 or 5/2, from exact distances (its slope at zero would magnify rounding).

    Args:
        nu: smoothness, 0.5, 1.5 or 2.5.
        inverse_lengthscale: 1 / l, ``(1,)`` or ``(D,)``.
        centers: the points Z, ``(n, D)``.
        outputscale: signal variance, scalar tensor.

    Reference: Rasmussen and Williams 2006, Eq. 4.16 and 4.17.
    """

    def __init__(self, nu: float, inverse_lengthscale: Tensor, centers: Tensor, outputscale: Tensor) -> None:
        self.nu = nu
        self.rate = inverse_lengthscale * math.sqrt(2.0 * nu)
        self.scaled_centers = centers * self.rate
        self.outputscale = outputscale

    def cross(self, z: Tensor, out: Tensor | None = None) -> Tensor:
        """See :class:`KernelFunction`."""
        distance = torch.cdist(z * self.rate, self.scaled_centers, compute_mode="donot_use_mm_for_euclid_dist")
        values = distance.neg().exp() * self.outputscale
        if self.nu > 1:
            values = values * (1.0 + distance + (distance.square() / 3.0 if self.nu > 2 else 0.0))
        values = values.unsqueeze(0)
        return values if out is None else out.copy_(values)

    def diagonal(self, z: Tensor) -> Tensor:
        """See :class:`KernelFunction`."""
        return self.outputscale.reshape(1, 1)


def kernel_function(kernel: Kernel, centers: Tensor) -> KernelFunction:
    """Prepare k(z, Z) for many queries.

    Args:
        kernel: any gpytorch kernel; its hyper-parameters are read now, so make a new function when they change.
        centers: the points Z, ``(n, D)``.

    Returns:
        A fast function for RBF and Matern kernels (with or without ARD and ScaleKernel), else gpytorch's own call.
    """
    outputscale = centers.new_ones(())
    inner = kernel
    while type(inner) is ScaleKernel and _plain(inner):
        outputscale = outputscale * inner.outputscale.detach()
        inner = inner.base_kernel
    if type(inner) not in (RBFKernel, MaternKernel) or not _plain(inner):
        return GpytorchFunction(kernel, centers)
    inverse_lengthscale = inner.lengthscale.detach().reshape(-1).reciprocal()
    if isinstance(inner, MaternKernel):
        return MaternFunction(inner.nu, inverse_lengthscale, centers, outputscale)
    return RBFFunction(inverse_lengthscale, centers, outputscale)


def _plain(kernel: Kernel) -> bool:
    return not kernel.batch_shape and kernel.active_dims is None
