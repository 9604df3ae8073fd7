from __future__ import annotations

import torch
from torch import nn

from torch_activegp.simulators.parameters import register_value


def test_a_constant_is_a_buffer_a_parameter_or_the_parameter_that_was_given() -> None:
    module, given = nn.Module(), nn.Parameter(torch.tensor(3.0))
    register_value(module, "fixed", 1.0, trainable=False)
    register_value(module, "free", 2.0, trainable=True)
    register_value(module, "given", given, trainable=False)
    assert list(dict(module.named_buffers())) == ["fixed"]
    assert list(dict(module.named_parameters())) == ["free", "given"]
    assert module.given is given
    assert module.fixed.dtype == module.free.dtype == torch.float64


def test_a_tensor_is_copied() -> None:
    module, value = nn.Module(), torch.tensor(1.0, dtype=torch.float64)
    register_value(module, "mass", value, trainable=False)
    value.fill_(5.0)
    assert module.mass == 1.0
