"""The function z -> k(z, Z) A, and when two kernels count as equal."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import pytest
import torch
from gpytorch.kernels import Kernel, MaternKernel, PolynomialKernel, RBFKernel, ScaleKernel
from torch import Tensor

from torch_activegp.means import KernelExpansion
from torch_activegp.means.kernel_expansion import merge_heads, same_kernel

DOUBLE = torch.float64


def rbf(z: Tensor, centers: Tensor, lengthscale: Tensor | float) -> Tensor:
    difference = (z[:, None] - centers[None]) / lengthscale
    return torch.exp(-difference.square().sum(-1) / 2)


def rbf_kernel(lengthscale: float = 0.7) -> RBFKernel:
    kernel = RBFKernel().double()
    kernel.lengthscale = torch.tensor(lengthscale, dtype=DOUBLE)
    return kernel


def points(generator: torch.Generator, *shape: int) -> Tensor:
    return torch.randn(*shape, generator=generator, dtype=DOUBLE)


def test_one_head_is_a_kernel_matrix_times_weights(generator: torch.Generator) -> None:
    z, centers, weights = points(generator, 6, 3), points(generator, 4, 3), points(generator, 1, 4, 2)
    values = KernelExpansion(rbf_kernel(), centers, weights)(z)
    torch.testing.assert_close(values, rbf(z, centers, 0.7) @ weights[0], rtol=0, atol=1e-13)


def test_a_shared_kernel_may_have_one_head_an_output(generator: torch.Generator) -> None:
    z, centers, weights = points(generator, 6, 3), points(generator, 4, 3), points(generator, 2, 4, 1)
    values = KernelExpansion(rbf_kernel(), centers, weights)(z)
    torch.testing.assert_close(values, rbf(z, centers, 0.7) @ weights[..., 0].mT, rtol=0, atol=1e-13)


def test_each_output_may_have_its_own_kernel(generator: torch.Generator) -> None:
    kernel = RBFKernel(batch_shape=torch.Size([2])).double()
    kernel.lengthscale = torch.tensor([0.5, 1.5], dtype=DOUBLE).reshape(2, 1, 1)
    z, centers, weights = points(generator, 6, 3), points(generator, 4, 3), points(generator, 2, 4, 1)
    values = KernelExpansion(kernel, centers, weights)(z)
    expected = torch.stack([(rbf(z, centers, scale) @ weights[j])[:, 0] for j, scale in enumerate((0.5, 1.5))], dim=-1)
    torch.testing.assert_close(values, expected, rtol=0, atol=1e-13)


def test_it_is_a_snapshot(generator: torch.Generator) -> None:
    kernel, centers, weights = rbf_kernel(), points(generator, 4, 3), points(generator, 1, 4, 2)
    expansion, z = KernelExpansion(kernel, centers, weights), points(generator, 6, 3)
    before = expansion(z)
    kernel.lengthscale = 3.0
    centers.zero_()
    weights.zero_()
    assert torch.equal(expansion(z), before)
    assert not before.requires_grad
    assert not any(parameter.requires_grad for parameter in expansion.parameters())
    assert next(kernel.parameters()).requires_grad


def test_gradients_reach_the_query(generator: torch.Generator) -> None:
    expansion = KernelExpansion(rbf_kernel(), points(generator, 4, 3), points(generator, 1, 4, 2))
    assert torch.autograd.gradcheck(expansion, points(generator, 3, 3).requires_grad_())


def test_state_dict_and_pickle_keep_the_numbers(generator: torch.Generator) -> None:
    expansion = KernelExpansion(rbf_kernel(), points(generator, 4, 3), points(generator, 1, 4, 2))
    fresh = KernelExpansion(rbf_kernel(2.0), torch.zeros(4, 3, dtype=DOUBLE), torch.zeros(1, 4, 2, dtype=DOUBLE))
    fresh.load_state_dict(expansion.state_dict())
    z = points(generator, 6, 3)
    for other in (fresh, pickle.loads(pickle.dumps(expansion))):
        assert torch.equal(other(z), expansion(z))


def test_merge_heads_puts_the_outputs_side_by_side(generator: torch.Generator) -> None:
    values = points(generator, 5, 3)
    assert torch.equal(merge_heads(values[None]), values)
    assert torch.equal(merge_heads(values.mT.unsqueeze(-1)), values)


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        (rbf_kernel, rbf_kernel, True),
        (rbf_kernel, lambda: rbf_kernel().eval(), True),
        (rbf_kernel, lambda: rbf_kernel(0.8), False),
        (RBFKernel, MaternKernel, False),
        (lambda: RBFKernel(ard_num_dims=2), RBFKernel, False),
        (lambda: RBFKernel(active_dims=[0]), lambda: RBFKernel(active_dims=[1]), False),
        (lambda: MaternKernel(nu=0.5), lambda: MaternKernel(nu=2.5), False),
        (lambda: PolynomialKernel(2), lambda: PolynomialKernel(3), False),
        (lambda: ScaleKernel(RBFKernel()), lambda: ScaleKernel(MaternKernel()), False),
        (lambda: ScaleKernel(RBFKernel()), lambda: ScaleKernel(RBFKernel()), True),
        (lambda: RBFKernel() + MaternKernel(), lambda: RBFKernel() * MaternKernel(), False),
    ],
)
def test_kernels_are_the_same_if_they_give_the_same_numbers(
    first: Callable[[], Kernel], second: Callable[[], Kernel], same: bool
) -> None:
    assert same_kernel(first(), second()) is same
    assert same_kernel(second(), first()) is same
