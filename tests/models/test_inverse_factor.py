"""The inverse Cholesky factor against torch.linalg."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from torch_activegp.models.inverse_factor import InverseFactor

DOUBLE = torch.float64


def positive_definite(heads: int, size: int, generator: torch.Generator, dtype: torch.dtype = DOUBLE) -> Tensor:
    root = torch.randn(heads, size, size, generator=generator, dtype=DOUBLE)
    return (root @ root.mT / max(size, 1) + torch.eye(size, dtype=DOUBLE)).to(dtype)


@pytest.mark.parametrize("heads", [1, 3])
@pytest.mark.parametrize("size", [1, 5, 127, 128, 192, 193, 300])
def test_inverse_and_squared_norm(heads: int, size: int, generator: torch.Generator) -> None:
    matrix = positive_definite(heads, size, generator)
    factor = InverseFactor(matrix)
    assert factor.size == size
    torch.testing.assert_close(factor.inverse.mT @ factor.inverse, torch.linalg.inv(matrix), rtol=0, atol=1e-11)
    assert torch.equal(factor.inverse, factor.inverse.tril())
    rows = torch.randn(heads, 7, size, generator=generator, dtype=DOUBLE)
    expected = (rows * torch.linalg.solve(matrix, rows.mT).mT).sum(-1)
    torch.testing.assert_close(factor.squared_norm(rows), expected, rtol=1e-11, atol=1e-11)


def test_shared_rows_meet_every_head(generator: torch.Generator) -> None:
    factor = InverseFactor(positive_definite(3, 200, generator))
    rows = torch.randn(1, 7, 200, generator=generator, dtype=DOUBLE)
    torch.testing.assert_close(factor.squared_norm(rows), factor.squared_norm(rows.expand(3, -1, -1)))


def test_without_points_nothing_is_explained() -> None:
    factor = InverseFactor(torch.zeros(2, 0, 0, dtype=DOUBLE))
    assert factor.size == 0
    assert torch.equal(factor.squared_norm(torch.zeros(2, 5, 0, dtype=DOUBLE)), torch.zeros(2, 5, dtype=DOUBLE))


@pytest.mark.parametrize("heads", [1, 3])
@pytest.mark.parametrize("start", [0, 1, 20])
def test_appending_equals_factoring_anew(heads: int, start: int, generator: torch.Generator) -> None:
    matrix = positive_definite(heads, 60, generator)
    factor = InverseFactor(matrix[:, :start, :start])
    for size in range(start, 60):
        row, pivot = factor.append(matrix[:, size, :size], matrix[:, size, size])
        lower = torch.linalg.cholesky(matrix[:, : size + 1, : size + 1])
        torch.testing.assert_close(row, lower[:, size, :size], rtol=0, atol=1e-12)
        torch.testing.assert_close(pivot, lower[:, size, size], rtol=0, atol=1e-12)
    fresh = InverseFactor(matrix)
    assert factor.size == 60
    torch.testing.assert_close(factor.inverse, fresh.inverse, rtol=0, atol=1e-12)
    assert torch.equal(factor.inverse, factor.inverse.tril())


def test_a_point_that_cannot_be_appended_is_refused_and_leaves_the_factor(generator: torch.Generator) -> None:
    matrix = positive_definite(2, 4, generator)
    factor = InverseFactor(matrix)
    corner = torch.stack([matrix[0, 0, 0] * 2, matrix[1, 0, 0] * (1 - 1e-9)])  # one head is fine, the other is not
    with pytest.raises(torch.linalg.LinAlgError, match="not positive definite; recompute the factor"):
        factor.append(matrix[:, 0], corner)
    assert factor.size == 4
    assert torch.equal(factor.inverse, InverseFactor(matrix).inverse)


def test_storage_is_copied_rarely(generator: torch.Generator) -> None:
    matrix = positive_definite(1, 200, generator)
    factor = InverseFactor(matrix[:, :1, :1])
    addresses = set()
    for size in range(1, 200):
        factor.append(matrix[:, size, :size], matrix[:, size, size])
        addresses.add((factor.inverse.data_ptr(), factor.inverse.stride()))
    assert len(addresses) <= 8


def test_float32_and_gradients_of_the_norm(generator: torch.Generator) -> None:
    single = InverseFactor(positive_definite(1, 200, generator, torch.float32))
    assert single.inverse.dtype == torch.float32
    factor = InverseFactor(positive_definite(1, 200, generator))
    rows = torch.randn(1, 2, 200, generator=generator, dtype=DOUBLE, requires_grad=True)
    assert torch.autograd.gradcheck(factor.squared_norm, rows)
