from __future__ import annotations

import pytest
import torch

from torch_activegp.data.outliers import outlying

TIME = torch.arange(400, dtype=torch.float64) * 0.01
SIGMA = 1e-3


@pytest.fixture
def swing(generator: torch.Generator) -> torch.Tensor:
    return torch.sin(6 * TIME) + SIGMA * torch.randn(400, generator=generator, dtype=torch.float64)


def found(signal: torch.Tensor, time: torch.Tensor = TIME, sigma: float = SIGMA) -> list[int]:
    return outlying(signal, time, sigma).nonzero().flatten().tolist()


@pytest.mark.parametrize("rows", [[4], [200], [395], [57, 58], [20, 90, 91, 300]])
def test_rows_far_from_their_neighbours_are_found_alone(swing: torch.Tensor, rows: list[int]) -> None:
    swing[rows] -= 0.1
    assert found(swing) == rows


@pytest.mark.parametrize("size", [4.0, -4.0, 0.0])
def test_what_noise_might_do_is_none(swing: torch.Tensor, size: float) -> None:
    swing[100] += size * SIGMA
    assert found(swing) == []


def test_the_clock_counts(generator: torch.Generator) -> None:
    time = TIME + 0.004 * torch.rand(400, generator=generator, dtype=torch.float64)
    signal = torch.sin(6 * time)
    assert found(signal, time, 1e-4) == []
    late = time.clone()
    late[80] += 0.003
    assert found(signal, late, 1e-4) == [80]


@pytest.mark.parametrize("between", [0.0, 0.25, 0.5, 0.75])
@pytest.mark.parametrize("back", [0.0, 0.6, 1.0])
@pytest.mark.parametrize("row", [0, 1, 2, 3, 5, 200, 394, 396, 397, 398])
def test_an_impact_is_none(swing: torch.Tensor, between: float, back: float, row: int) -> None:
    after = TIME - TIME[row] - between * 0.01
    fall = torch.where(after < 0, 8.0 * after, -back * 8.0 * after)
    assert found(fall + swing - torch.sin(6 * TIME)) == []


def test_a_coarse_encoder_has_none() -> None:
    slow = (torch.sin(0.5 * TIME) / 0.01).round() * 0.01
    assert found(slow, sigma=0.01 / 12**0.5) == []


def test_few_rows_tell_nothing() -> None:
    spike = torch.zeros(8)
    spike[4] = 1.0
    assert found(spike, TIME[:8]) == []


def test_long_signals_are_cut_up_without_a_seam(generator: torch.Generator) -> None:
    signal = 1e-3 * torch.randn(9000, generator=generator, dtype=torch.float64)
    rows = [4099, 4100, 4115, 8192, 8990]
    signal[rows] += 1.0
    assert found(signal, torch.arange(9000.0, dtype=torch.float64)) == rows
