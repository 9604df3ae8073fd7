"""Physical constants of a module: buffers, or parameters that can be trained."""

from __future__ import annotations

import torch
from torch import Tensor, nn


def register_value(module: nn.Module, name: str, value: float | Tensor, trainable: bool) -> None:
    """Give a module a constant that follows it to other devices and into its state dict.

    Args:
        module: gets the constant as an attribute.
        name: of the attribute.
        value: a number or tensor, stored as float64; an ``nn.Parameter`` is kept as it is.
        trainable: make it an ``nn.Parameter``.
    """
    if isinstance(value, nn.Parameter):
        module.register_parameter(name, value)
        return
    tensor = torch.as_tensor(value, dtype=torch.float64).detach().clone()
    if trainable:
        module.register_parameter(name, nn.Parameter(tensor))
    else:
        module.register_buffer(name, tensor)
