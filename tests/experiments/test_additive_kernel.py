from __future__ import annotations

import math

import gpytorch
import pytest
import torch
from gpytorch.kernels import MaternKernel, RBFKernel

from torch_activegp.errors import ConfigurationError
from torch_activegp.experiments.additive_kernel import CircleKernel, additive_matern

LOW, HIGH = torch.tensor([0.0, -1.0, -3.0]).double(), torch.tensor([4.0, 1.0, 3.0]).double()


def points(size: int = 6) -> torch.Tensor:
    return 3 * torch.randn(size, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)


@pytest.mark.parametrize("nu", [0.5, 1.5, 2.5])
def test_it_is_the_sum_of_one_kernel_an_input_and_one_of_all(nu: float) -> None:
    z, kernel = points(), additive_matern(LOW, HIGH, nu=nu)
    extent = HIGH - LOW
    wanted = torch.zeros(6, 6).double()
    for columns in ([0], [1], [2], [0, 1, 2]):
        part = MaternKernel(nu, ard_num_dims=len(columns)).double()
        part.lengthscale = extent[columns] / 4
        wanted = wanted + part(z[:, columns]).to_dense()
    torch.testing.assert_close(kernel(z).to_dense(), wanted)
    torch.testing.assert_close(kernel(z, diag=True), wanted.diagonal())
    batched = kernel(z.expand(2, 6, 3)).to_dense()
    torch.testing.assert_close(batched, wanted.expand(2, 6, 6))


def test_an_angle_is_a_point_on_the_circle() -> None:
    kernel = additive_matern(LOW, HIGH, angles=[2])
    z = points()
    turned = z + torch.tensor([0.0, 0.0, 2 * math.pi])
    torch.testing.assert_close(kernel(z, turned).to_dense(), kernel(z).to_dense(), atol=1e-6, rtol=0)
    assert not torch.allclose(additive_matern(LOW, HIGH)(z, turned).to_dense(), kernel(z).to_dense())
    assert torch.linalg.eigvalsh(kernel(points(30)).to_dense()).min() > 0


def test_what_one_input_does_is_carried_to_unseen_combinations() -> None:
    """A function of one input, learned along a line, is partly known far from it; by the joint kernel, not at all."""
    chance = torch.Generator().manual_seed(0)
    x = torch.rand(40, 2, generator=chance, dtype=torch.float64) * torch.tensor([2.0, 0.05])
    far = torch.tensor([[0.5, 3.0], [1.5, -3.0]]).double()
    low, high = torch.zeros(2).double(), torch.tensor([2.0, 0.05]).double()
    kernel = additive_matern(low, high)
    for part, known in ((kernel, True), (kernel.base_kernel.kernels[-1], False)):
        covariance = part(x).to_dense() + 1e-4 * torch.eye(40)
        mean = part(far, x).to_dense() @ torch.linalg.solve(covariance, torch.sin(3 * x[:, 0]))
        share = mean / torch.sin(3 * far[:, 0])
        assert bool((share > 0.6).all() if known else (share.abs() < 1e-6).all())


def test_priors_and_length_scales_are_in_units_of_the_ranges() -> None:
    kernel = additive_matern(LOW, HIGH, angles=[0])
    parts = kernel.base_kernel.kernels
    assert [part.base_kernel.lengthscale.flatten().tolist() for part in parts] == [
        [0.5, 0.5],  # an angle that sees the whole circle
        [0.5],
        [1.5],
        [0.5, 0.5, 0.5, 1.5],
    ]
    assert len(list(kernel.named_priors())) == 8


def test_a_constant_input_and_a_single_input_do_no_harm() -> None:
    kernel = additive_matern(torch.tensor([1.0, 0.0]).double(), torch.tensor([1.0, 2.0]).double())
    assert kernel.base_kernel.kernels[0].base_kernel.lengthscale.item() == pytest.approx(0.25)
    assert len(additive_matern(LOW[:1], HIGH[:1]).base_kernel.kernels) == 1


def test_gradients_flow_and_the_state_dict_round_trips() -> None:
    first, second = additive_matern(LOW, HIGH, [1]), additive_matern(2 * LOW, 3 * HIGH, [1])
    z = points().requires_grad_()
    (gradient,) = torch.autograd.grad(first(z, points(4)).to_dense().sum(), z)
    assert bool((gradient.abs() > 0).any())
    second.load_state_dict(first.state_dict())
    assert torch.equal(first(points()).to_dense(), second(points()).to_dense())


def test_the_circle_kernel_takes_any_kernel() -> None:
    kernel = CircleKernel(RBFKernel(ard_num_dims=3), angles=[1])
    x = torch.tensor([[0.0, 3.0], [0.0, -3.0]])
    distance = 2 * math.sin((2 * math.pi - 6) / 2)
    lengthscale = kernel.base_kernel.lengthscale[0, 0].item()
    with gpytorch.settings.lazily_evaluate_kernels(False):
        value = kernel(x).to_dense()[0, 1].item()
    assert value == pytest.approx(math.exp(-0.5 * (distance / lengthscale) ** 2), rel=1e-5)


@pytest.mark.parametrize("high", [math.inf, math.nan, -1.0])
def test_ranges_are_checked(high: float) -> None:
    with pytest.raises(ConfigurationError, match="wanted finite low <= high, found ranges"):
        additive_matern(torch.zeros(1), torch.tensor([high]))
