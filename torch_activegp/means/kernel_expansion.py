"""A weighted sum of kernel functions: what a Gaussian process adds to its mean."""

from __future__ import annotations

from copy import deepcopy

import gpytorch
import torch
from torch import Tensor, nn


def same_kernel(first: gpytorch.kernels.Kernel, second: gpytorch.kernels.Kernel) -> bool:
    """Whether two kernels are built alike, with equal hyper-parameters."""
    if _structure(first) != _structure(second):
        return False
    ours, theirs = first.state_dict(), second.state_dict()
    return ours.keys() == theirs.keys() and all(torch.equal(ours[key], theirs[key]) for key in ours)


def _structure(kernel: gpytorch.kernels.Kernel) -> list[tuple[type, dict[str, object]]]:
    """The class and the plain numbers (nu of a Matern kernel, power of a polynomial one) of every part."""
    return [
        (type(part), {k: v for k, v in vars(part).items() if isinstance(v, int | float | str) and k != "training"})
        for part in kernel.modules()
    ]


class KernelExpansion(nn.Module):
    """The function z -> k(z, Z) A with a snapshot of the kernel.

    ``h`` is the number of heads: 1 when one kernel serves all outputs, ``d`` when each output has its own.

    Args:
        kernel: its hyper-parameters are copied and frozen.
        centers: the points Z, ``(n, D)``.
        weights: the matrix A, ``(h, n, d / h)``.
    """

    centers: Tensor
    weights: Tensor

    def __init__(self, kernel: gpytorch.kernels.Kernel, centers: Tensor, weights: Tensor) -> None:
        super().__init__()
        self.kernel = deepcopy(kernel).requires_grad_(False).eval()
        # In one memory layout, whatever that of the originals: products then agree bit for bit after a restart.
        self.register_buffer("centers", centers.detach().clone(memory_format=torch.contiguous_format))
        self.register_buffer("weights", weights.detach().clone(memory_format=torch.contiguous_format))

    def forward(self, z: Tensor) -> Tensor:
        """Evaluate the sum.

        Args:
            z: inputs, ``(n', D)``.

        Returns:
            The values, ``(n', d)``.
        """
        with gpytorch.settings.lazily_evaluate_kernels(False):
            cross = self.kernel(z, self.centers).to_dense()
        return merge_heads(cross.reshape(-1, *cross.shape[-2:]) @ self.weights)


def merge_heads(values: Tensor) -> Tensor:
    """Put the heads of ``(h, n, d / h)`` side by side: ``(n, d)``."""
    return values[0] if values.shape[0] == 1 else values.movedim(0, -2).flatten(-2)
