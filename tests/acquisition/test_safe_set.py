"""Side information: 0 inside, -inf outside, never NaN, and no gradient."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from tensordict import TensorDict
from torch import Tensor, nn

from torch_activegp import keys
from torch_activegp.acquisition import Box, SafeSet
from torch_activegp.errors import ConfigurationError, ShapeError

INF, NAN = float("inf"), float("nan")
STATES = torch.tensor([[0.0, 0.0], [1.0, -2.0], [1.5, 0.0], [0.0, NAN], [INF, 0.0], [-INF, NAN]])
VALUES = [0.0, 0.0, -INF, -INF, -INF, -INF]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("shape", [(6,), (2, 3), (6, 1)])
@pytest.mark.parametrize(
    "contains",
    [
        Box([-1.0, -2.0], [1.0, 2.0]),
        lambda x: ~((x[..., 0].abs() > 1) | (x[..., 1].abs() > 2)),  # calls NaN inside
        lambda x: ((x[..., :1].abs() <= 1) & ~(x[..., 1:].abs() > 2)).to(x),  # (..., 1), numbers
        lambda x: torch.ones(x.shape[:-1]) * (x[..., 0] < 1.2),
    ],
)
def test_zero_inside_and_minus_infinity_outside(
    contains: Callable[[Tensor], Tensor], shape: tuple[int, ...], dtype: torch.dtype
) -> None:
    value = SafeSet(contains).evaluate(STATES.to(dtype).reshape(*shape, 2))
    assert value.dtype == dtype
    assert torch.equal(value, torch.tensor(VALUES, dtype=dtype).reshape(*shape, 1))


def test_a_finite_penalty_is_paid_instead() -> None:
    assert SafeSet(Box([-1.0, -2.0], [1.0, 2.0]), penalty=7.0).evaluate(STATES).flatten().tolist() == [
        -7.0 if value else 0.0 for value in VALUES
    ]
    for wrong in (0.0, -1.0, NAN):
        with pytest.raises(ConfigurationError, match="SafeSet: wanted a penalty > 0, found"):
            SafeSet(Box([0.0], [1.0]), penalty=wrong)


def test_it_tests_the_next_state_or_whatever_in_keys_say() -> None:
    points = TensorDict({"loc": torch.tensor([[2.0]]), "state": torch.tensor([[0.0]])}, [1])
    box = Box([-1.0], [1.0])
    assert SafeSet(box)(points)["safe"].item() == -INF
    assert SafeSet(box, in_keys=[keys.STATE])(points)["safe"].item() == 0.0


def test_it_stops_gradients() -> None:
    state = torch.tensor([[0.5, 0.5], [3.0, NAN]], requires_grad=True)
    value = SafeSet(lambda x: x.square().sum(-1) < 1).evaluate(state)
    assert not value.requires_grad
    total = (value[:1] + state[:1].sum()).sum()
    assert torch.equal(torch.autograd.grad(total, state)[0], torch.tensor([[1.0, 1.0], [0.0, 0.0]]))


def test_a_learned_set_is_a_submodule() -> None:
    class Ball(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.radius = nn.Parameter(torch.tensor(2.0))

        def forward(self, state: Tensor) -> Tensor:
            return state.norm(dim=-1) < self.radius

    safe = SafeSet(Ball())
    assert [name for name, _ in safe.named_parameters()] == ["contains.radius"]
    assert safe.evaluate(torch.tensor([[1.0, 1.0], [2.0, 1.0]])).flatten().tolist() == [0.0, -INF]


@pytest.mark.parametrize(
    ("contains", "found"),
    [(lambda x: x.abs() < 1, r"\(4, 2\)"), (lambda x: True, r"\(\)"), (lambda x: x[0, 0] < 1, "")],
)
def test_one_answer_a_state_is_wanted(contains: Callable[[Tensor], Tensor], found: str) -> None:
    with pytest.raises(ShapeError, match=rf"`contains` should return \(4,\), found {found}.*all\(-1\)"):
        SafeSet(contains).evaluate(torch.zeros(4, 2))


def test_the_corners_belong_to_the_box_in_every_dtype() -> None:
    box = Box([-0.1, 0.1], [0.1, 0.3])
    for dtype in (torch.float32, torch.float64):
        corners = torch.tensor([[-0.1, 0.1], [0.1, 0.3]], dtype=dtype)
        assert box(corners).tolist() == [True, True]
        assert box(corners * 1.001).tolist() == [False, False]


@pytest.mark.parametrize(("low", "high"), [([0.0, 1.0], [1.0, 0.0]), ([0.0], [1.0, 1.0]), ([NAN], [1.0])])
def test_a_box_has_two_corners_in_order(low: list[float], high: list[float]) -> None:
    with pytest.raises(ConfigurationError, match="Box: wanted low <= high for each state, found"):
        Box(low, high)
