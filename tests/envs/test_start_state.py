"""A start state is honoured, or refused aloud."""

from __future__ import annotations

import pytest
import torch
from tensordict import TensorDict

from torch_activegp.envs.start_state import given_state
from torch_activegp.errors import ConfigurationError, ShapeError

LIKE = torch.zeros((), dtype=torch.float64)


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_it_is_a_copy_in_the_wanted_dtype(batch: tuple[int, ...]) -> None:
    for dtype in (torch.float32, torch.float64):
        td = TensorDict({"state": torch.ones(*batch, 2, dtype=dtype)}, batch)
        state = given_state(td, LIKE, 2)
        state.zero_()
        assert state.dtype == torch.float64
        assert state.shape == (*batch, 2)
        assert td["state"].eq(1).all()


def test_none_is_refused() -> None:
    for td in (None, TensorDict({}), TensorDict({"observation": torch.ones(2)})):
        with pytest.raises(ConfigurationError, match=r"set_state=True\) wants a tensordict with 'state', found none"):
            given_state(td, LIKE, 2)


def test_another_shape_is_refused() -> None:
    td = TensorDict({"state": torch.ones(4, 3)}, [4])
    with pytest.raises(
        ShapeError, match=r"wanted a state of shape \(4, 2\) in a tensordict of shape \(4,\), found \(4, 3"
    ):
        given_state(td, LIKE, 2)


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_a_state_that_is_not_finite_is_refused(bad: float) -> None:
    with pytest.raises(ConfigurationError, match="wanted a finite state, found"):
        given_state(TensorDict({"state": torch.tensor([0.0, bad])}), LIKE, 2)
