"""Where an imagined step goes."""

from __future__ import annotations

import pickle

import pytest
import torch

from torch_activegp.envs import MeanTransition, OptimisticTransition, Transition
from torch_activegp.errors import ConfigurationError


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_values(batch: tuple[int, ...], dtype: torch.dtype, generator: torch.Generator) -> None:
    loc, scale, eta = (torch.rand(*batch, 4, generator=generator, dtype=dtype) for _ in range(3))
    quantities = {"loc": loc, "scale": scale}
    assert torch.equal(MeanTransition().next_state(quantities, eta[..., :0]), loc)
    for beta in (0.0, 0.5, 3.0):
        moved = OptimisticTransition(beta).next_state(quantities, eta)
        assert moved.dtype == dtype
        torch.testing.assert_close(moved, loc + beta * scale * eta)


def test_optimism_reaches_the_edges_of_the_confidence_interval() -> None:
    quantities = {"loc": torch.tensor([1.0, 2.0]), "scale": torch.tensor([0.1, 0.2])}
    up, down = (OptimisticTransition(2.0).next_state(quantities, sign * torch.ones(2)) for sign in (1, -1))
    torch.testing.assert_close(up, torch.tensor([1.2, 2.4]))
    torch.testing.assert_close(down, torch.tensor([0.8, 1.6]))


def test_needs_and_extra_actions() -> None:
    assert (MeanTransition().needs, MeanTransition().num_extra_actions(18)) == (("loc",), 0)
    optimistic = pickle.loads(pickle.dumps(OptimisticTransition(2.0)))
    assert (optimistic.needs, optimistic.num_extra_actions(18), optimistic.beta) == (("loc", "scale"), 18, 2.0)
    with pytest.raises(TypeError, match="abstract"):
        Transition()


@pytest.mark.parametrize("beta", [-0.1, float("nan")])
def test_beta_is_not_negative(beta: float) -> None:
    with pytest.raises(ConfigurationError, match="Wanted beta >= 0, found"):
        OptimisticTransition(beta)
