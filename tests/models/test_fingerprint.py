"""Changes of modules are noticed, whoever made them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from gpytorch.kernels import Kernel, MaternKernel, RBFKernel, ScaleKernel
from torch import nn

from torch_activegp.models.fingerprint import Fingerprint


def set_lengthscale(kernel: Kernel) -> None:
    kernel.base_kernel.lengthscale = 0.3


def replace_base(kernel: Kernel) -> None:
    kernel.base_kernel = MaternKernel()  # with the same parameters as the RBF kernel


def add_buffer(kernel: Kernel) -> None:
    kernel.register_buffer("extra", torch.zeros(()))


def load(kernel: Kernel) -> None:
    kernel.load_state_dict({name: value + 0.5 for name, value in kernel.state_dict().items()})


def edit_in_place(kernel: Kernel) -> None:
    with torch.no_grad():
        kernel.raw_outputscale.add_(1.0)


@pytest.mark.parametrize("change", [set_lengthscale, replace_base, add_buffer, load, edit_in_place])
def test_a_change_is_seen_once(change: Callable[[Kernel], None]) -> None:
    kernel, other, fingerprint = ScaleKernel(RBFKernel()), nn.Linear(2, 2), Fingerprint()
    assert fingerprint.changed([kernel, other])
    assert not fingerprint.changed([kernel, other])
    change(kernel)
    assert fingerprint.changed([kernel, other])
    assert not fingerprint.changed([kernel, other])


def test_another_module_or_value_is_a_change() -> None:
    fingerprint, layer, value = Fingerprint(), nn.Linear(2, 2), torch.zeros(2)
    assert fingerprint.changed([layer], [value])
    value[0] = 1.0
    assert fingerprint.changed([layer], [value])
    assert fingerprint.changed([layer], [torch.zeros(3)])
    assert fingerprint.changed([layer])
    assert fingerprint.changed([layer, nn.Identity()])
    assert not fingerprint.changed([]) or not fingerprint.changed([])


def test_modes_and_gradients_are_no_change() -> None:
    fingerprint, layer = Fingerprint(), nn.Linear(2, 2)
    fingerprint.changed([layer])
    layer(torch.ones(2)).sum().backward()
    layer.eval().requires_grad_(False)
    assert not fingerprint.changed([layer])
