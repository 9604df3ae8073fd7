"""The two layouts of a vector-valued function."""

from __future__ import annotations

import gpytorch
import pytest
import torch
from torch import Tensor

from torch_activegp.errors import ShapeError
from torch_activegp.means import EpisodicMean, predict_mean
from torch_activegp.means.layout import evaluate_per_output

DOUBLE = torch.float64


class Counted:
    """Outputs (sum, product) of the inputs; counts its calls."""

    def __init__(self) -> None:
        self.calls = 0

    def __call__(self, z: Tensor) -> Tensor:
        self.calls += 1
        return torch.stack([z.sum(-1), z.prod(-1)], dim=-1)


@pytest.mark.parametrize("dtype", [torch.float32, DOUBLE])
@pytest.mark.parametrize("batch", [(), (1,), (2,), (4, 1), (4, 2)])
def test_all_outputs_at_equal_inputs_take_one_call(
    batch: tuple[int, ...], dtype: torch.dtype, generator: torch.Generator
) -> None:
    function = Counted()
    z = torch.rand(*batch[:-1], *(1,) * bool(batch), 5, 3, generator=generator, dtype=dtype)
    x = z.expand(*batch, 5, 3)
    values = evaluate_per_output(function, x, 2)
    assert function.calls == 1
    assert values.dtype == dtype
    assert values.shape == (*batch[:-1], 2, 5)
    expected = torch.stack([z.sum(-1), z.prod(-1)], dim=-2) if not batch else None
    if expected is None:
        expected = torch.cat([z.sum(-1), z.prod(-1)], dim=-2)
    torch.testing.assert_close(values, expected)


def test_each_output_sees_its_own_inputs_where_they_differ(generator: torch.Generator) -> None:
    x = torch.rand(3, 2, 5, 3, generator=generator, dtype=DOUBLE)
    values = evaluate_per_output(Counted(), x, 2)
    assert values.shape == (3, 2, 5)
    torch.testing.assert_close(values[:, 0], x[:, 0].sum(-1))
    torch.testing.assert_close(values[:, 1], x[:, 1].prod(-1))


def test_inputs_for_another_number_of_outputs_are_refused() -> None:
    with pytest.raises(ShapeError, match=r"\(\.\.\., 2, n, D\) for 2 outputs, found \(3, 5, 3\)\. Give every output"):
        evaluate_per_output(Counted(), torch.zeros(3, 5, 3), 2)


@pytest.mark.parametrize("equal", [True, False])
def test_gradients_reach_the_inputs(equal: bool, generator: torch.Generator) -> None:
    x = torch.rand(2, 4, 3, generator=generator, dtype=DOUBLE)
    x = (x[:1].expand(2, -1, -1) if equal else x).clone().requires_grad_()
    evaluate_per_output(Counted(), x, 2).sum().backward()
    assert x.grad is not None
    assert bool((x.grad != 0).any())


@pytest.mark.parametrize("batch_shape", [(), (2,)])
def test_predict_mean_of_gpytorchs_means(batch_shape: tuple[int, ...], generator: torch.Generator) -> None:
    z = torch.rand(5, 3, generator=generator, dtype=DOUBLE)
    constant = gpytorch.means.ConstantMean(batch_shape=torch.Size(batch_shape)).double()
    constant.constant.data.copy_(torch.arange(1.0, 3.0)[: constant.constant.numel()].reshape(batch_shape))
    assert torch.equal(predict_mean(constant, z, 2), constant.constant.detach().expand(5, 2))
    linear = gpytorch.means.LinearMean(3, batch_shape=torch.Size(batch_shape)).double()
    weights = linear.weights.detach().expand(2, 3, 1)[..., 0]
    bias = linear.bias.detach().expand(2, 1)[..., 0]
    torch.testing.assert_close(predict_mean(linear, z, 2), z @ weights.T + bias)


def test_predict_mean_prefers_the_method_of_our_means(generator: torch.Generator) -> None:
    z = torch.rand(5, 3, generator=generator, dtype=DOUBLE)
    mean = EpisodicMean(gpytorch.means.ConstantMean(), num_outputs=2)
    assert torch.equal(predict_mean(mean, z, 2), mean.predict(z))
