from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from torch_activegp.errors import ShapeError
from torch_activegp.simulators.integrators import Integrator, rk4, semi_implicit_euler


def oscillator(state: Tensor, action: Tensor) -> Tensor:
    """q'' = -q + u."""
    position, velocity = state.chunk(2, -1)
    return torch.cat((velocity, action - position), -1)


def error_after_one_second(integrator: Integrator, steps: int) -> float:
    state = torch.tensor([1.0, 0.0], dtype=torch.float64)
    for _ in range(steps):
        state = integrator(oscillator, state, torch.zeros(1, dtype=torch.float64), 1.0 / steps)
    return (state - torch.tensor([math.cos(1.0), -math.sin(1.0)], dtype=torch.float64)).norm().item()


@pytest.mark.parametrize(("integrator", "order"), [(rk4, 4), (semi_implicit_euler, 1)])
def test_halving_the_step_divides_the_error_by_two_to_the_order(integrator: Integrator, order: int) -> None:
    ratio = error_after_one_second(integrator, 40) / error_after_one_second(integrator, 80)
    assert math.log2(ratio) == pytest.approx(order, abs=0.1)


def test_semi_implicit_euler_keeps_the_energy_of_an_oscillator_bounded() -> None:
    state = torch.tensor([1.0, 0.0], dtype=torch.float64)
    for _ in range(5_000):
        state = semi_implicit_euler(oscillator, state, torch.zeros(1, dtype=torch.float64), 0.05)
    assert 0.9 < state.norm().item() < 1.1


def test_semi_implicit_euler_moves_with_the_new_velocity() -> None:
    state = semi_implicit_euler(oscillator, torch.tensor([1.0, 2.0]), torch.tensor([4.0]), 0.1)
    assert state.tolist() == pytest.approx([1.0 + 0.1 * 2.3, 2.3])


def test_semi_implicit_euler_wants_positions_and_as_many_velocities() -> None:
    with pytest.raises(ShapeError, match="found 3 dimensions. Use rk4"):
        semi_implicit_euler(lambda state, action: state, torch.zeros(3), torch.zeros(1), 0.1)


@pytest.mark.parametrize("integrator", [rk4, semi_implicit_euler])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_shape_and_dtype_stay(integrator: Integrator, dtype: torch.dtype, batch: tuple[int, ...]) -> None:
    state = integrator(oscillator, torch.ones(*batch, 4, dtype=dtype), torch.ones(*batch, 2, dtype=dtype), 0.1)
    assert (state.shape, state.dtype) == ((*batch, 4), dtype)


@pytest.mark.parametrize("integrator", [rk4, semi_implicit_euler])
def test_gradients_are_exact(integrator: Integrator) -> None:
    generator = torch.Generator().manual_seed(0)
    state = torch.randn(2, 2, dtype=torch.float64, generator=generator, requires_grad=True)
    action = torch.randn(2, 1, dtype=torch.float64, generator=generator, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x, u: integrator(oscillator, x, u, 0.1), (state, action))
