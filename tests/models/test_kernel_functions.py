"""Fast kernel evaluation against gpytorch's own."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from gpytorch.kernels import (
    Kernel,
    LinearKernel,
    MaternKernel,
    PeriodicKernel,
    PolynomialKernel,
    RBFKernel,
    RQKernel,
    ScaleKernel,
)
from torch import Tensor

from torch_activegp.models.kernel_functions import (
    GpytorchFunction,
    KernelFunction,
    MaternFunction,
    RBFFunction,
    kernel_function,
)

DOUBLE = torch.float64


class MyRBF(RBFKernel):
    """A user's subclass may compute anything: it must take the general path."""


def ard(kernel: Kernel) -> Kernel:
    kernel.lengthscale = torch.tensor([[0.4, 1.3, 2.6]], dtype=DOUBLE)
    return kernel


def scaled(kernel: Kernel, outputscale: float = 2.3) -> Kernel:
    outer = ScaleKernel(kernel).double()
    outer.outputscale = outputscale
    return outer


def batched(kernel: Kernel) -> Kernel:
    kernel.double().lengthscale = torch.tensor([0.5, 1.5], dtype=DOUBLE).reshape(2, 1, 1)
    return kernel


TWO = torch.Size([2])
KERNELS: dict[str, tuple[Callable[[], Kernel], type[KernelFunction], int]] = {
    "rbf": (RBFKernel, RBFFunction, 1),
    "rbf ard": (lambda: ard(RBFKernel(ard_num_dims=3).double()), RBFFunction, 1),
    "scaled rbf": (lambda: scaled(RBFKernel()), RBFFunction, 1),
    "scaled twice": (lambda: scaled(scaled(RBFKernel(), 0.4)), RBFFunction, 1),
    "matern 1/2": (lambda: MaternKernel(nu=0.5), MaternFunction, 1),
    "matern 3/2": (lambda: MaternKernel(nu=1.5), MaternFunction, 1),
    "matern 5/2": (lambda: MaternKernel(nu=2.5), MaternFunction, 1),
    "scaled matern ard": (lambda: scaled(ard(MaternKernel(nu=1.5, ard_num_dims=3).double())), MaternFunction, 1),
    "active dims": (lambda: RBFKernel(active_dims=[0, 2]), GpytorchFunction, 1),
    "scaled active dims": (lambda: scaled(MaternKernel(active_dims=[1])), GpytorchFunction, 1),
    "subclass": (MyRBF, GpytorchFunction, 1),
    "periodic": (PeriodicKernel, GpytorchFunction, 1),
    "rational quadratic": (RQKernel, GpytorchFunction, 1),
    "linear": (LinearKernel, GpytorchFunction, 1),
    "polynomial": (lambda: PolynomialKernel(2), GpytorchFunction, 1),
    "sum": (lambda: scaled(RBFKernel()) + LinearKernel(), GpytorchFunction, 1),
    "product": (lambda: RBFKernel() * PeriodicKernel(), GpytorchFunction, 1),
    "one kernel an output": (lambda: batched(RBFKernel(batch_shape=TWO)), GpytorchFunction, 2),
    "one scale an output": (lambda: ScaleKernel(RBFKernel(), batch_shape=TWO), GpytorchFunction, 2),
    "one matern an output": (lambda: batched(MaternKernel(batch_shape=TWO)), GpytorchFunction, 2),
}


def points(generator: torch.Generator, size: int) -> Tensor:
    return 1.5 * torch.randn(size, 3, generator=generator, dtype=DOUBLE)


@pytest.mark.parametrize("queries", [1, 6])
@pytest.mark.parametrize("name", KERNELS)
def test_it_equals_gpytorch(name: str, queries: int, generator: torch.Generator) -> None:
    make, path, heads = KERNELS[name]
    kernel, z, centers = make().double(), points(generator, queries), points(generator, 40)
    function = kernel_function(kernel, centers)
    assert type(function) is path
    expected = kernel(z, centers).to_dense().reshape(heads, queries, 40)
    values = function.cross(z)
    assert values.shape == (heads, queries, 40)
    torch.testing.assert_close(values, expected.detach(), rtol=0, atol=1e-10, check_dtype=True)
    diagonal = kernel(z).to_dense().diagonal(dim1=-2, dim2=-1).reshape(heads, queries)
    torch.testing.assert_close(function.diagonal(z).expand(heads, queries), diagonal, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", KERNELS)
def test_it_writes_to_memory_that_it_is_given(name: str, generator: torch.Generator) -> None:
    make, _, heads = KERNELS[name]
    kernel, z, centers = make().double(), points(generator, 6), points(generator, 40)
    function = kernel_function(kernel, centers)
    memory = torch.full((heads, 6, 40), torch.nan, dtype=DOUBLE)
    with torch.no_grad():
        values = function.cross(z, memory)
        assert values.data_ptr() == memory.data_ptr()
        torch.testing.assert_close(memory, function.cross(z), rtol=0, atol=1e-14)


@pytest.mark.parametrize("name", KERNELS)
def test_its_gradient_is_that_of_gpytorch(name: str, generator: torch.Generator) -> None:
    make, _, heads = KERNELS[name]
    kernel, centers = make().double(), points(generator, 40)
    weights = torch.randn(heads, 4, 40, generator=generator, dtype=DOUBLE)
    function, gradients = kernel_function(kernel, centers), []
    for cross in (function.cross, lambda z: kernel(z, centers).to_dense()):
        z = points(torch.Generator().manual_seed(5), 4).requires_grad_()
        (cross(z) * weights).sum().backward()
        gradients.append(z.grad)
    torch.testing.assert_close(*gradients, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("make", [lambda: scaled(RBFKernel()), lambda: scaled(MaternKernel(nu=0.5))])
def test_data_far_from_zero_loses_no_digits(make: Callable[[], Kernel], generator: torch.Generator) -> None:
    kernel, shift = make().double(), torch.tensor([4e3, -2e5, 0.0], dtype=DOUBLE)
    centers = points(generator, 40)
    near, far = kernel_function(kernel, centers), kernel_function(kernel, centers + shift)
    z = points(generator, 6)
    torch.testing.assert_close(far.cross(z + shift), near.cross(z), rtol=0, atol=1e-9)
    coincident = far.cross(centers + shift)[0].diagonal()
    torch.testing.assert_close(coincident, far.diagonal(centers).reshape(1).expand(40).detach(), rtol=0, atol=1e-12)


def test_float32_stays_float32(generator: torch.Generator) -> None:
    kernel, z, centers = RBFKernel(), points(generator, 6).float(), points(generator, 40).float()
    values = kernel_function(kernel, centers).cross(z)
    assert values.dtype == torch.float32
    torch.testing.assert_close(values[0], kernel(z, centers).to_dense().detach(), rtol=0, atol=1e-5)


def test_hyper_parameters_are_read_once(generator: torch.Generator) -> None:
    kernel, z, centers = RBFKernel().double(), points(generator, 6), points(generator, 40)
    function = kernel_function(kernel, centers)
    before = function.cross(z)
    kernel.lengthscale = 3.0
    assert torch.equal(function.cross(z), before)
    assert not torch.equal(kernel_function(kernel, centers).cross(z), before)
