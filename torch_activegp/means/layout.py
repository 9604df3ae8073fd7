"""Between the two layouts of a vector-valued function: ours ``(n, d)`` and gpytorch's batch ``(d, n)``."""

from __future__ import annotations

from collections.abc import Callable

import gpytorch
import torch
from torch import Tensor

from torch_activegp.errors import ShapeError


def evaluate_per_output(function: Callable[[Tensor], Tensor], x: Tensor, num_outputs: int) -> Tensor:
    """Evaluate ``function`` as a gpytorch mean of batch shape ``(d,)``.

    gpytorch models ``d`` outputs as a batch: output ``j`` sees its own copy ``x[..., j, :, :]`` of the inputs. The
    copies are nearly always equal, so ``function`` is then called once.

    Args:
        function: maps ``(..., n, D)`` to all outputs, ``(..., n, d)``.
        x: inputs, ``(n, D)`` or ``(..., d or 1, n, D)``.
        num_outputs: the number of outputs ``d``.

    Returns:
        The mean, ``(..., d, n)``.

    Raises:
        ShapeError: the batch dimension of ``x`` is neither 1 nor ``d``.
    """
    if x.dim() < 3:
        return function(x).mT
    if x.shape[-3] not in (1, num_outputs):
        raise ShapeError(
            f"Wanted inputs of shape (n, D) or (..., {num_outputs}, n, D) for {num_outputs} outputs, found "
            f"{tuple(x.shape)}. Give every output the same inputs: x.expand({num_outputs}, *x.shape[-2:])."
        )
    first = x[..., :1, :, :]
    if x.shape[-3] == 1 or torch.equal(x, first.expand_as(x)):
        return function(first.squeeze(-3)).mT
    return torch.stack([function(x[..., j, :, :])[..., j] for j in range(num_outputs)], dim=-2)


def predict_mean(mean_module: gpytorch.means.Mean, z: Tensor, num_outputs: int) -> Tensor:
    """Evaluate any gpytorch mean at ``z``, all outputs side by side.

    Args:
        mean_module: a mean with a ``predict`` method (ours), or any gpytorch mean of batch shape ``()`` or ``(d,)``.
        z: inputs, ``(n, D)``.
        num_outputs: the number of outputs ``d``.

    Returns:
        The mean, ``(n, d)``.
    """
    if hasattr(mean_module, "predict"):
        return mean_module.predict(z)
    return mean_module(z.expand(num_outputs, *z.shape)).mT
