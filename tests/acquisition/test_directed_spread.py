from __future__ import annotations

import gpytorch
import pytest
import torch
from tensordict import TensorDict

from torch_activegp import keys
from torch_activegp.acquisition import DirectedSpread
from torch_activegp.means import SimulatorMean
from torch_activegp.models import DynamicsGP, FixedNoise, PosteriorModule
from torch_activegp.simulators import Pendulum


@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_it_is_the_formula(batch: tuple[int, ...], dtype: torch.dtype, generator: torch.Generator) -> None:
    scale, loc, base, unit = (torch.rand(*batch, 3, generator=generator, dtype=dtype) + 0.1 for _ in range(4))
    value = DirectedSpread().evaluate(scale, loc, base, unit)
    sigma = (scale / unit).square().mean(-1, keepdim=True).sqrt()
    gap = ((loc - base) / unit).square().mean(-1, keepdim=True).sqrt()
    assert value.shape == (*batch, 1)
    assert value.dtype == dtype
    torch.testing.assert_close(value, sigma * (gap + sigma))


def test_units_do_not_matter(generator: torch.Generator) -> None:
    values = [torch.rand(4, 2, generator=generator) + 0.1 for _ in range(4)]
    unit = torch.tensor([1000.0, 1.0])
    torch.testing.assert_close(
        DirectedSpread().evaluate(*values), DirectedSpread().evaluate(*(unit * v for v in values))
    )


def test_at_equal_uncertainty_it_prefers_where_the_simulator_was_seen_to_be_wrong() -> None:
    gp = DynamicsGP(SimulatorMean(Pendulum()), gpytorch.kernels.RBFKernel(), noise=FixedNoise(1e-2))
    state, action = torch.tensor([[-1.5, 0.0], [1.5, 0.0]]), torch.zeros(2, 1)
    following = Pendulum()(state, action) + torch.tensor([[0.0, 0.0], [0.0, 1.0]])
    gp.update(state, action, following)
    beside = TensorDict({keys.STATE: state + torch.tensor([0.0, 0.5]), keys.ACTION: action}, [2])
    score = DirectedSpread()
    td = score(PosteriorModule(gp, out_keys=score.in_keys)(beside))
    torch.testing.assert_close(td[keys.SCALE][0], td[keys.SCALE][1], rtol=1e-3, atol=0)
    right, wrong = td["directed_spread"].flatten().tolist()
    assert wrong > 1.3 * right
